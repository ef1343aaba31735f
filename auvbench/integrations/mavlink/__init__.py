"""Connect a pilot over MAVLink to a vehicle that runs ArduSub (docs/mavlink.md).

The package imports pymavlink when first needed, and never imports torch, numba or Hydra. It cites ArduPilot's source at
commit b95f0dd02a0d5c7ea1c7f530aa041b377fa6fe16 of eivacom/arudupilot, a fork of November 2025 (ArduSub 4.7.0-dev).
"""
