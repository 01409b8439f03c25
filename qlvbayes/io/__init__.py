"""Files, and what users read of them: measurements, layouts of machines, units, plain errors."""
