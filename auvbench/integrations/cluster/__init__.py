"""Train on a cluster: SLURM and Ray (docs/cluster.md)."""
