"""Agents, which map observations to actions: classical controllers and learned policies with the same interface."""
