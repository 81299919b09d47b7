"""The air of the shop: heating with setback, outdoors, weather, doors that open."""

import numpy as np

from pipeline.shop.parameters import DAY, AirParameters, ShopParameters

STEP = 60  # s, of the grid on which the air is computed


def ambient_temperature(parameters: ShopParameters) -> np.ndarray:
    """Temperature of the air [degC] at each minute of all days, shape (days * 1440,)."""
    from pipeline.shop.filters import lagged

    p, random = parameters.air, parameters.generator("air")
    minutes = np.arange(parameters.days * DAY // STEP)
    hour = minutes * STEP / 3600 % 24
    day = minutes * STEP // DAY
    heated = np.where((hour >= 4.5) & (hour < 17.5), p.working, p.setback)
    target = np.where(day % 7 < 5, heated, p.weekend)
    weather = np.cumsum(random.normal(0, 0.6, parameters.days)) * p.day_to_day / 1.5
    outside = p.daily_amplitude * np.cos(2 * np.pi * (hour - 15) / 24)
    share = 1 - np.exp(-STEP / (3600 * p.building_lag))
    building = lagged(target, share, p.weekend)
    wander = lagged(random.normal(0, 1, minutes.size), 1 / 45, 0.0) * 0.25 * np.sqrt(90)
    smooth_weather = np.interp(minutes / 1440, np.arange(parameters.days) + 0.5, weather)
    doors = _doors(p, day, hour, random)
    air: np.ndarray = building + outside + np.clip(smooth_weather, -4, 4) + wander - doors
    return air


def _doors(
    p: AirParameters, day: np.ndarray, hour: np.ndarray, random: np.random.Generator
) -> np.ndarray:
    """Cold [K] that doors let in: a drop that recovers exponentially."""
    from pipeline.shop.filters import lagged

    working = (day % 7 < 5) & (hour >= 6) & (hour < 17)
    opened = random.random(day.size) < np.where(working, p.doors_a_day / (11 * 60), 0.0)
    share = 1 - np.exp(-1 / p.door_recovery)
    drops = opened * random.uniform(0.4, 1.6, day.size) * p.door_drop / share
    cold: np.ndarray = lagged(drops, share, 0.0)
    return cold


def of_day(ambient: np.ndarray, day: int) -> np.ndarray:
    """The air of one day at each second [degC], shape (86400,)."""
    grid = np.arange(ambient.size) * STEP
    seconds = day * DAY + np.arange(DAY)
    return np.asarray(np.interp(seconds, grid, ambient))
