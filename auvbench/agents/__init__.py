"""Agents, which turn observations into actions: classical controllers and learned policies behind one contract."""
