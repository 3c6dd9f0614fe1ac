"""Tables about the accuracy of reconstructed scans and of the materials assigned to scanned surfaces."""
