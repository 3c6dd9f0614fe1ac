"""Read and write colour-and-depth frames with camera poses, in several folder layouts."""
