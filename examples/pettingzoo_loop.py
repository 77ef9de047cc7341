"""PettingZoo: a team in the `ParallelEnv`, every UAV an agent, and a picture of its episode.

    python examples/pettingzoo_loop.py --steps 200 --picture episode.png

An agent that is done leaves `env.agents`, while the others fly on; nobody left means that the episode is over.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib.image
import tyro

import osl_env


def main(steps: int = 200, seed: int = 0, picture: Path | None = None) -> None:
    """Fly random hops inside the area until the episode is over, or for `steps` decisions of each UAV.

    Args:
        steps: The most decisions of each UAV.
        seed: Of the episode: it fixes source, wind, hits and radio, whatever the UAVs do.
        picture: Where to write a PNG of the tracks; none by default.
    """
    env = osl_env.parallel_env("rate-100x60x30-random", render_mode="rgb_array", max_cycles=steps)
    _, infos = env.reset(seed=seed)
    returns = dict.fromkeys(env.possible_agents, 0.0)
    for i, agent in enumerate(env.possible_agents):
        env.action_space(agent).seed(seed + i)
    while env.agents:
        actions = {}
        for agent in env.agents:
            mask = env.action_mask(agent)  # the hops that end inside; others are shortened
            mask[-1] = 0  # do not declare: at random it is a false declaration, which ends the episode
            actions[agent] = env.action_space(agent).sample(mask)
        _, rewards, _, _, infos = env.step(actions)
        for agent, reward in rewards.items():
            returns[agent] += reward
    for agent, info in infos.items():
        print(f"{agent}: {info['search_time']:.0f} s, {info['energy'] / 1000:.0f} kJ, return {returns[agent]:.2f}")
    image = env.render()
    if picture is not None and image is not None:
        matplotlib.image.imsave(picture, image)
        print(f"picture: {picture}")
    env.close()


if __name__ == "__main__":
    tyro.cli(main)
