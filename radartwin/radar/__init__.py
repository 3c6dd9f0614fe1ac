"""Model the radar: waveform and array, TI files, DCA1000 recordings, range/Doppler/angle processing, detection, pictures."""
