"""Export of a calibrated robot to other simulators and robot descriptions, and what each of them carries."""
