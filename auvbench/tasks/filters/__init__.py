"""Filters of commands: `barrier` keeps a vehicle away from solids and limits, `rows` has its constraints, `quadratic` its programme."""
