"""What a run is and where it lies: identity, directory, durable files, records, provenance, locks, status."""
