"""What turns a clean recording into what features are read from: its source decides the key of the processed products."""

from radartwin.features import processed
from radartwin.simulation.signal import synthesis
from radartwin.testbed import testbed

__all__ = ["processed", "synthesis", "testbed"]
