"""Read and write files safely: whole outputs, bounded inputs."""
