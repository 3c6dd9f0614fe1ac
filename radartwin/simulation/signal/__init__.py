"""From paths to IQ samples."""
