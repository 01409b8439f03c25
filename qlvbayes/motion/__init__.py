"""From readings to records: motion, phases, the noise floor, block averages, a pad made ready."""
