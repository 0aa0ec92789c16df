"""Check single streams of samples: values, time stamps, order, rates and silence."""
