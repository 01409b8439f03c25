"""Figures for papers, as Matplotlib figures that belong to nobody's window."""
