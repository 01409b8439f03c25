"""Files and what users read of them: measurements, machines' layouts, units, error messages."""
