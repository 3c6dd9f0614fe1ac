"""Files, untrusted input, progress, secrets, servers and worker processes."""
