"""Read and write files, lock files, read untrusted input, run worker processes, print progress, and call a chat server. Every other package
of radartwin may import this package.
"""
