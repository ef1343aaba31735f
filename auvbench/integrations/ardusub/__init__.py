"""Provide the physics of an unmodified ArduSub: the bytes of its JSON backend, its frames, and a server
(docs/ardusub.md).

Sources of ArduPilot in this package are of commit b95f0dd02a0d5c7ea1c7f530aa041b377fa6fe16 of
eivacom/arudupilot, a fork of November 2025 (ArduSub 4.7.0-dev).
"""
