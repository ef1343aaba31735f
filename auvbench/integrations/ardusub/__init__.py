"""Simulate a vehicle for an unmodified ArduSub (docs/ardusub.md).

The package has the packets of ArduPilot's JSON backend, ArduSub's frames, a server and an agent. It cites ArduPilot's
source at commit b95f0dd02a0d5c7ea1c7f530aa041b377fa6fe16 of eivacom/arudupilot, a fork of November 2025
(ArduSub 4.7.0-dev).
"""
