"""Fit the numbers of a vehicle sheet to logs, with their uncertainty, and compare sheets with logs (docs/identification.md)."""
