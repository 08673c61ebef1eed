"""Figures for print: pictures with scale bar, color bar, letters and caption, as plain data and as files."""
