"""Read and write folders of colour-and-depth frames with camera poses, in the file formats of several programs."""
