"""Store real radar captures as recording sets: folders with recordings, an index and a data card. Import, select and check recordings."""
