"""Divide a scan's mesh into segments. Each segment is one surface."""
