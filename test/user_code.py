"""What users write, with types that mypy checks."""

import numpy as np

from ca_ros import (
    AdmissibleSet,
    AllocationProblem,
    Exact,
    Status,
    Vehicle,
    audit,
    make_allocator,
    make_detector,
)


def main() -> None:
    """Call what users call; the assignments have the types that they get."""
    vehicle = Vehicle.load('hexarotor')
    allocator = Exact(vehicle, policy='scale')
    answer = allocator.allocate([9.81, 0.0, 0.0, 0.0])
    residual: float = answer.certificate.kkt_residual
    margin: float = answer.certificate.margin
    status: Status = answer.status
    exact: bool = answer.is_exact and answer.is_close(1e-9)
    assert residual < 1e-12 < margin
    assert exact == (status is Status.EXACT)

    batch = allocator.allocate_batch(np.ones((3, 4)))
    residuals: np.ndarray = batch.certificate.kkt_residual
    assert residuals.max() < 1e-12
    assert [str(each) for each in batch.explanation] == [str(each.explanation) for each in batch]
    assert batch[0:2].to_frame().shape[0] == 2

    failed = allocator.with_health([0, 1, 1, 1, 1, 1])
    lost: tuple[str, ...] = failed.lost_axes
    side: np.ndarray = audit(vehicle).side_force
    assert lost == ('yaw',)
    assert not side.any()
    assert bool(AdmissibleSet(vehicle).contains([9.81, 0.0, 0.0, 0.0]))
    slow = allocator.within_rates(2000.0).allocate([9.81, 0, 0, 0], vehicle.hover_speeds, 0.01)
    assert slow.status is Status.EXACT

    problem = AllocationProblem([[1, 1], [1, -1]], -1, 1)
    other = make_allocator('exact', problem).with_matrix([[1, 1], [2, -1]])
    assert other.allocate([0.5, 0.5]).effectors.shape == (2,)

    detector = make_detector(vehicle, motor_time_constant=0.02)
    detector.command(0, answer.speeds)
    changed: bool = detector.observe(0, [0, 0, 0, 1], [0, 0, 0], [0, 0, 0])
    health: np.ndarray = detector.health
    assert not changed
    assert health.tolist() == [1.0] * 6
