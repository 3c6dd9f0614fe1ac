"""The simulators behind one protocol."""
