"""Independent references for the ray tracer: closed forms, series and quadratures that share no code with radartwin.simulation."""
