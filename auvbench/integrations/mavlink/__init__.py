"""Connect a pilot to a vehicle that runs ArduSub by MAVLink (docs/mavlink.md).

pymavlink is imported when first needed; torch, numba and Hydra never are. Sources of ArduPilot in this
package are of commit b95f0dd02a0d5c7ea1c7f530aa041b377fa6fe16 of eivacom/arudupilot, a fork of November 2025
(ArduSub 4.7.0-dev).
"""
