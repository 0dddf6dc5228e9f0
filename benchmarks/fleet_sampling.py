# SPDX-License-Identifier: Apache-2.0
"""The empirical Bayes of a fleet beside a full posterior by Markov chains (NUTS of numpyro).

    python -m pip install -r requirements-sampling.txt     (600 MB)
    python benchmarks/fleet_sampling.py [--seed S] [--lots L] [--devices N]

Devices of L lots of one type are drawn from the simulator's population, slopes with the error
of a `short_20min` campaign times four, so that shrinkage has something to do. The chains know the
hierarchy, not its numbers: weak priors on means, scatters and correlations of type, lots and
devices. What stands in closed form in `fleet/population.py` is compared with the chains' means and
standard deviations: lots' means, scatter in a lot, and every device.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np
from imu_driver.simulation.population import draw_fleet_device, draw_lots
from imu_workbench.fleet.statistics.population import device_effects, error_variances, populations
from imu_workbench.fleet.statistics.vectors import SENSORS, Vectors

STD = 2.4e-5
"""Error of a slope of the gyroscope [rad/s/K]."""
RUNS = 3
WARM_UP, DRAWS = 500, 1000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seed', type=int, default=3)
    parser.add_argument('--lots', type=int, default=4)
    parser.add_argument('--devices', type=int, default=120)
    options = parser.parse_args()
    vectors = drawn(options.lots, options.devices, options.seed)
    start = time.process_time()
    lots, _ = populations(vectors)
    error = error_variances(vectors)
    devices = [
        device_effects(group.coefficients, error[vectors.lot == lot.lot], lot.mean, lot.covariance)
        for lot, (_, group) in zip(lots, vectors.groups(), strict=True)
    ]
    closed = time.process_time() - start
    chains = sampled(vectors, np.sqrt(error), options.seed)
    print(f'closed form {closed:.2f} s, chains {time.process_time() - start:.0f} s of processor')
    mean, std = chains['lot_mean'].mean(axis=0), chains['lot_mean'].std(axis=0)
    print_off("lots' means", [lot.mean for lot in lots], mean, std)
    own = [np.sqrt(np.diag(lot.mean_covariance)) for lot in lots]
    print(f'  their deviation over that of the chains: {spread(own / std)}')
    mean, std = chains['within'].mean(axis=0), chains['within'].std(axis=0)
    print_off('scatter in a lot', [np.sqrt(np.diag(lot.covariance)) for lot in lots], mean, std)
    mean, std = chains['device'].mean(axis=0), chains['device'].std(axis=0)
    print_off('devices', np.concatenate([one[0] for one in devices]), mean, std)
    own = np.sqrt(np.concatenate([np.einsum('nii->ni', one[1]) for one in devices]))
    print(f'  their deviation over that of the chains: {spread(own / std)}')


def drawn(lots: int, devices: int, seed: int) -> Vectors:
    """Return the gyroscope of a fleet without outliers."""
    chosen = draw_lots(lots, seed)
    draw = np.random.default_rng((seed, 5))
    fleet = [draw_fleet_device(chosen, k, devices, seed) for k in range(devices)]
    fleet = [device for device in fleet if not device.outlier]
    n = len(fleet)
    slopes = np.array([device.slopes[3:6] for device in fleet])
    return Vectors(
        sensor=SENSORS[1],
        unit='rad/s/K',
        device=np.array([d.parameters.name for d in fleet]),
        type=np.full(n, 'none'),
        lot=np.array([d.lot for d in fleet]),
        coefficients=slopes + STD * draw.normal(size=(n, 3)),
        std=np.full((n, 3), STD),
        run_std=np.full((n, 3), STD * RUNS**0.5),
        runs=np.full(n, RUNS),
        misfit=np.zeros(n),
        measured_at=np.arange(n),
    )


def sampled(vectors: Vectors, error: np.ndarray, seed: int) -> dict[str, np.ndarray]:
    """Return draws of the lots' means, the scatter in each and the devices' slopes [SI unit/K]."""
    import jax
    from numpyro.infer import MCMC, NUTS

    scale = vectors.coefficients.std()
    names, lot = np.unique(vectors.lot, return_inverse=True)
    chains = MCMC(
        NUTS(hierarchy, target_accept_prob=0.95),
        num_warmup=WARM_UP,
        num_samples=DRAWS,
        progress_bar=False,
    )
    chains.run(jax.random.key(seed), vectors.coefficients / scale, error / scale, lot, len(names))
    divergent = int(chains.get_extra_fields()['diverging'].sum())
    print(f'{len(vectors)} devices of {len(names)} lots, {DRAWS} draws, {divergent} divergent')
    found = chains.get_samples()
    return {name: np.asarray(found[name]) * scale for name in ('lot_mean', 'within', 'device')}


def hierarchy(y: Any, error: Any, lot: Any, lots: int) -> None:
    """Type, lots, devices, measurement; in deviations of all slopes."""
    import jax.numpy as jnp
    import numpyro
    from numpyro import distributions as dist

    type_mean = numpyro.sample('type_mean', dist.Normal(0.0, 3.0).expand([3]).to_event(1))
    between = numpyro.sample('between', dist.HalfNormal(3.0).expand([3]).to_event(1))
    between_shape = numpyro.sample('between_shape', dist.LKJCholesky(3, 1.0))
    with numpyro.plate('lots', lots):
        step = numpyro.sample('lot_step', dist.Normal().expand([3]).to_event(1))
        within = numpyro.sample('within', dist.HalfNormal(3.0).expand([3]).to_event(1))
        shape = numpyro.sample('within_shape', dist.LKJCholesky(3, 1.0))
    lot_mean = type_mean + step @ (between[:, None] * between_shape).T
    numpyro.deterministic('lot_mean', lot_mean)
    with numpyro.plate('devices', len(y)):
        own = numpyro.sample('device_step', dist.Normal().expand([3]).to_event(1))
        root = within[..., None] * shape
        device = lot_mean[lot] + jnp.einsum('nij,nj->ni', root[lot], own)
        numpyro.deterministic('device', device)
        numpyro.sample('y', dist.Normal(device, error).to_event(1), obs=y)


def print_off(name: str, closed: Any, mean: np.ndarray, std: np.ndarray) -> None:
    off = (np.asarray(closed) - mean) / std
    print(
        f'{name}: off by {np.sqrt(np.mean(off**2)):.2f} (rms), {np.abs(off).max():.2f} (most) of '
        "the chains' standard deviations"
    )


def spread(ratio: np.ndarray) -> str:
    return f'{np.median(ratio):.2f} ({np.min(ratio):.2f} … {np.max(ratio):.2f})'


if __name__ == '__main__':
    main()
