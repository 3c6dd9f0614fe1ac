"""Describe radars, read and write radar files and recordings, and process recordings to range, Doppler, angle and detected echoes."""
