"""What is measured: speed as ratios within one run."""
