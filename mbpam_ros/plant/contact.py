# ruff: noqa: ANN001, ANN201  (compiled functions: numba infers the types)
r"""Contact: where bodies touch, and the force law between them.

A contact has a point, a normal N (into the body that is pushed: the object, or a finger on the table) and a Jacobian J
that maps the system's velocities to the relative velocity (3) and relative turning rate (3) there. With depth d > 0 at
the start of a step of length h and the velocity v after it:

    normal     f = max(0, k d - (k h + c) v.N)                      penalty at the end of the step; never pulls
    tangential F_t = -mu f v_t / max(|v_t|, v_slip)                 Coulomb, sticking below v_slip
    spin       T_n = -mu f l_spin w_n / max(|w_n|, w_slip)          friction of a soft patch about its normal
    rolling    T_t = -f l_roll w_t / max(|w_t|, w_slip)             hysteresis of a soft patch

Every force is a function of the velocity after the step, so the forces reported are those that moved the bodies.
"""

from __future__ import annotations

from numba import njit

from mbpam_ros.plant.finger import STATIONS, station
from mbpam_ros.plant.shapes import signed_distance


@njit
def _distance_along(bx, by, muscle, s, base, solid, half, centre, rotation, found):
    """Write distance, centreline point and outward normal at arc length s into ``found`` (7,).

    Returns the slope of the distance along the muscle.
    """
    x, y, z, tx, ty, tz = station(bx, by, muscle, s)
    px, py, pz = base[0] + x, base[1] + y, base[2] + z
    dx, dy, dz = px - centre[0], py - centre[1], pz - centre[2]
    distance, gx, gy, gz = signed_distance(
        solid,
        half,
        rotation[0, 0] * dx + rotation[1, 0] * dy + rotation[2, 0] * dz,
        rotation[0, 1] * dx + rotation[1, 1] * dy + rotation[2, 1] * dz,
        rotation[0, 2] * dx + rotation[1, 2] * dy + rotation[2, 2] * dz,
    )
    nx = rotation[0, 0] * gx + rotation[0, 1] * gy + rotation[0, 2] * gz
    ny = rotation[1, 0] * gx + rotation[1, 1] * gy + rotation[1, 2] * gz
    nz = rotation[2, 0] * gx + rotation[2, 1] * gy + rotation[2, 2] * gz
    found[0], found[1], found[2], found[3] = distance, px, py, pz
    found[4], found[5], found[6] = nx, ny, nz
    return nx * tx + ny * ty + nz * tz


@njit
def sample_distances(bx, by, muscle, base, solid, half, centre, rotation, found, distances) -> float:
    """Write the distances of STATIONS points of the centreline into ``distances``; return their spacing [m].

    The muscle is a ball of its radius swept along the centreline up to one radius before its end, so that its rounded
    tip ends where the muscle ends.
    """
    spacing = (2.0 * muscle[0] + muscle[1] - muscle[2]) / (STATIONS - 1)
    for k in range(STATIONS):
        _distance_along(bx, by, muscle, k * spacing, base, solid, half, centre, rotation, found)
        distances[k] = found[0]
    return spacing


@njit
def may_touch(distances, k, radius, spacing) -> bool:
    """Return whether sample k is a local minimum that may be within ``radius``.

    The distance changes by no more than the arc length, so none near a sample is nearer by more than the spacing.
    """
    if distances[k] - spacing > radius:
        return False
    return (k == 0 or distances[k] < distances[k - 1]) and (k == STATIONS - 1 or distances[k] <= distances[k + 1])


@njit
def deepest_near(bx, by, muscle, base, solid, half, centre, rotation, k, spacing, found):
    """Return depth [m] and arc length [m] of the minimum of the distance beside sample k.

    Illinois steps on the slope of the distance, so the point moves smoothly with the bend. ``found`` (7,) is then the
    distance of the centreline, its point and the solid's outward normal there.
    """
    s = k * spacing
    low, high, low_slope, high_slope, side = s, s, 0.0, 0.0, 0
    for trial in range(16):  # the sample, its neighbour, Illinois steps
        slope = _distance_along(bx, by, muscle, s, base, solid, half, centre, rotation, found)
        if trial == 0:
            if (k == STATIONS - 1 and slope <= 0.0) or (k == 0 and slope >= 0.0):
                break
            low_slope, high_slope = slope, slope
            s += spacing if slope < 0.0 else -spacing
            continue
        if trial == 1:
            if s > high:
                high, high_slope = s, slope
            else:
                low, low_slope = s, slope
            if not low_slope < 0.0 < high_slope:
                s = k * spacing  # a kink (the solid's edge) at the sample
                _distance_along(bx, by, muscle, s, base, solid, half, centre, rotation, found)
                break
        elif abs(slope) < 1e-7 or high - low < 1e-8:
            break
        elif slope < 0.0:
            low, low_slope = s, slope
            high_slope *= 0.5 if side < 0 else 1.0
            side = -1
        else:
            high, high_slope = s, slope
            low_slope *= 0.5 if side > 0 else 1.0
            side = 1
        s = (low * high_slope - high * low_slope) / (high_slope - low_slope)
    return muscle[2] - found[0], s


@njit
def force_law(law, depth, h, normal, velocity, grip, force):
    """Write force and torque (6,) on the pushed body for the relative velocity (6,) after the step; return f.

    Friction is that of the normal force ``grip``, or of f itself where ``grip`` is negative.
    """
    vn = normal[0] * velocity[0] + normal[1] * velocity[1] + normal[2] * velocity[2]
    wn = normal[0] * velocity[3] + normal[1] * velocity[4] + normal[2] * velocity[5]
    f = law[0] * depth - (law[0] * h + law[1]) * vn
    f = max(f, 0.0)
    grip = f if grip < 0.0 else grip
    slip, roll = 0.0, 0.0
    for i in range(3):
        slip += (velocity[i] - vn * normal[i]) ** 2
        roll += (velocity[3 + i] - wn * normal[i]) ** 2
    slip, roll = max(slip**0.5, law[5]), max(roll**0.5, law[6])
    spin = max(abs(wn), law[6])
    for i in range(3):
        force[i] = f * normal[i] - grip * law[2] / slip * (velocity[i] - vn * normal[i])
        force[3 + i] = -grip * (law[3] / spin * wn * normal[i] + law[4] / roll * (velocity[3 + i] - wn * normal[i]))
    return f


@njit
def force_slope(law, h, normal, velocity, f, grip, force, whole, secant, slope):
    """Write -d(force)/d(velocity) (6, 6) at the normal force f and the friction load ``grip``.

    ``whole``: the derivative with friction following f. Otherwise at constant friction load: symmetric, positive.
    ``secant``: friction as a constant resistance, force over velocity; never less than the derivative.
    """
    vn = normal[0] * velocity[0] + normal[1] * velocity[1] + normal[2] * velocity[2]
    wn = normal[0] * velocity[3] + normal[1] * velocity[4] + normal[2] * velocity[5]
    slip, roll = 0.0, 0.0
    for i in range(3):
        slip += (velocity[i] - vn * normal[i]) ** 2
        roll += (velocity[3 + i] - wn * normal[i]) ** 2
    slip, roll = slip**0.5, roll**0.5
    drag = grip * law[2] / max(slip, law[5])
    twist = 0.0 if abs(wn) > law[6] and not secant else grip * law[3] / max(abs(wn), law[6])
    curl = grip * law[4] / max(roll, law[6])
    grow = (law[0] * h + law[1]) / f if f > 0.0 else 0.0
    for i in range(3):
        ti, ri = velocity[i] - vn * normal[i], velocity[3 + i] - wn * normal[i]
        for j in range(3):
            across = (1.0 if i == j else 0.0) - normal[i] * normal[j]
            linear, angular = drag * across, curl * across + twist * normal[i] * normal[j]
            if slip > law[5] and not secant:
                linear -= drag * ti * (velocity[j] - vn * normal[j]) / (slip * slip)
            if roll > law[6] and not secant:
                angular -= curl * ri * (velocity[3 + j] - wn * normal[j]) / (roll * roll)
            slope[i, j] = linear + grow * (force[i] if whole else f * normal[i]) * normal[j]
            slope[i, 3 + j] = 0.0
            slope[3 + i, j] = grow * force[3 + i] * normal[j] if whole else 0.0
            slope[3 + i, 3 + j] = angular
