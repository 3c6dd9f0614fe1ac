"""What turns a clean recording into what features are read from: its source decides the key of the processed products."""

from radartwin.features import processed
from radartwin.measured import testbed
from radartwin.simulation import synthesis

__all__ = ["processed", "synthesis", "testbed"]
