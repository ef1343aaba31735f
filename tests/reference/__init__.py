"""A plain NumPy transcription of the equations, which shares no line of code with the package.

It is slow and meant to be read beside the textbook. The compiled simulator is compared with it number by number.
"""
