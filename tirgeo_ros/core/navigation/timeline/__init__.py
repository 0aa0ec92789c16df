"""Run the filter along its time line of IMU samples and measurements, late ones included."""
