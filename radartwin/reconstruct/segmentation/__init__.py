"""Divide a scan's mesh into segments, each one surface."""
