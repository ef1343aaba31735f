"""Tianshou: SAC with a collector on environments in subprocesses."""

import gymnasium as gym
import tianshou
import torch
from tianshou.algorithm import SAC
from tianshou.algorithm.modelfree.sac import SACPolicy
from tianshou.algorithm.optim import AdamOptimizerFactory
from tianshou.data import Collector, VectorReplayBuffer
from tianshou.env import DummyVectorEnv, SubprocVectorEnv
from tianshou.trainer import OffPolicyTrainerParams
from tianshou.utils.net.common import Net
from tianshou.utils.net.continuous import ContinuousActorProbabilistic, ContinuousCritic

ID = "auvbench:auvbench/Waypoint-v1"


def make():
    return gym.make(ID, render_mode=None, max_episode_steps=50)


if __name__ == "__main__":
    train, test = SubprocVectorEnv([make] * 2), DummyVectorEnv([make])
    train.seed(1)
    one = make()
    shape, n_u = one.observation_space.shape, one.action_space.shape
    actor = ContinuousActorProbabilistic(
        preprocess_net=Net(state_shape=shape, hidden_sizes=[32]),
        action_shape=n_u,
        unbounded=True,
        conditioned_sigma=True,
    )

    def critic():
        net = Net(state_shape=shape, action_shape=n_u, hidden_sizes=[32], concat=True)
        return ContinuousCritic(preprocess_net=net)

    optim = AdamOptimizerFactory(lr=1e-3)
    sac = SAC(
        policy=SACPolicy(actor=actor, action_space=one.action_space),
        policy_optim=optim,
        critic=critic(),
        critic_optim=optim,
        critic2=critic(),
        critic2_optim=optim,
    )
    collector = Collector(sac, train, VectorReplayBuffer(2000, 2))
    collector.reset()
    collector.collect(n_step=200, random=True)
    result = sac.run_training(
        OffPolicyTrainerParams(
            training_collector=collector,
            test_collector=Collector(sac, test),
            max_epochs=1,
            epoch_num_steps=300,
            collection_step_num_env_steps=20,
            test_step_num_episodes=1,
            batch_size=32,
        )
    )
    assert result is not None
    assert torch.isfinite(next(actor.parameters())).all()
    train.close()
    print("trained 500 steps; Tianshou", tianshou.__version__)
