"""Four interfaces to one batch of environments: gymnasium.Env, gymnasium.vector.VectorEnv, SB3's VecEnv and PettingZoo's ParallelEnv."""
