"""What turns observations into actions: SB3's learners, the PID baseline, the random floor."""
