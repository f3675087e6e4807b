"""What flight takes from a battery, the long way: powers one by one, and legs in small steps of time."""

import math

STEP_S = 0.002


def fraction(power, airspeed, climb):
    """Power of flight over that of hovering: each part in watts for a thrust of one newton, then their sum."""
    hover = power.induced_m_s
    low, high = 0.0, hover
    for _ in range(80):  # momentum theory: v sqrt(V^2 + v^2) = v_h^2
        middle = 0.5 * (low + high)
        low, high = (middle, high) if middle * math.hypot(airspeed, middle) < hover * hover else (low, middle)
    drag_newton = (power.drag_1_s * airspeed + power.drag_1_m * airspeed * airspeed) / 9.80665
    lift = climb if climb > 0.0 else climb * power.descent_gain
    blades_hover = hover * power.profile_share / (1.0 - power.profile_share)
    blades = blades_hover * (1.0 + 3.0 * airspeed * airspeed / power.tip_m_s**2)
    rotors_hover = hover + blades_hover
    rotors = max(0.0, low + drag_newton * airspeed + lift + blades)
    return power.idle_share + (1.0 - power.idle_share) * rotors / rotors_hover


def leg(power, a, b, *, speed, acceleration, wind):
    """Seconds, and seconds of hovering, from rest to rest with an even acceleration: the speed is looked up at every step."""
    length = math.dist(a, b)
    unit = [(y - x) / length for x, y in zip(a, b, strict=True)]
    at, time, used = 0.0, 0.0, 0.0
    while at < length:
        now = min(speed, math.sqrt(2.0 * acceleration * at), math.sqrt(2.0 * acceleration * (length - at)))
        now = max(now, 0.5 * acceleration * STEP_S)
        east, north = now * unit[0] - wind[0], now * unit[1] - wind[1]
        airspeed = math.sqrt(east**2 + north**2 + 2.0 * power.gust_m_s**2)
        used += STEP_S * fraction(power, airspeed, now * unit[2])
        time += STEP_S
        at += now * STEP_S
    return time, used
