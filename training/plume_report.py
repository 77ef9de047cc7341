"""What `osl plume stats` prints of a plume or a field: facts, readings downwind of the source, and the wind."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, cast

from rich.table import Table

from osl_env.fields import statistics
from osl_env.plumes.filament import FilamentPlume
from osl_env.plumes.filament_blocks import FilamentState
from training.plume_statistics import Measurement
from training.plume_subjects import RecordedField, SimulatedPlume, Subject


def facts(subject: Subject) -> dict[str, Any]:
    """What is known of `subject` without measuring, for JSON."""
    if isinstance(subject, RecordedField):
        field = subject.field
        held = sum(array.nbytes for array in (field.wind, field.concentration, field.solid) if array is not None)
        return {"card": field.card, "memory_bytes": held, "statistics": statistics(field)}
    assert isinstance(subject, SimulatedPlume)
    scenario, plume = subject.world.scenario, subject.world.scenario.plume
    known: dict[str, Any] = {
        "description": scenario.description,
        "area_m": list(scenario.arena.size),
        "sources_m": subject.sources.tolist(),
        "plume": plume.kind,
        "wind": scenario.wind.kind,
        "gas_sensor": scenario.gas_sensor.kind,
        "tick_s": plume.tick,
        "lead_time_s": plume.lead_time,
    }
    if isinstance(plume, FilamentPlume):
        known["filaments"] = len(plume.filaments(cast(FilamentState, subject.world.surroundings.plume_state), 0).ages)
    return known


def tables(subject: Subject, about: dict[str, Any], found: Measurement) -> Iterator[Any]:
    """Printable parts, 80 columns wide."""
    yield f"[bold]{subject.name}[/bold]"
    yield _facts_table(
        about["statistics"] | _card_lines(about["card"], about["memory_bytes"]) if "card" in about else about
    )
    yield ""
    if found.stations:
        yield _stations_table(subject, found)
        yield f"[dim]{_rule(found)}[/dim]\n"
    yield _wind_table(found)


def _card_lines(card: dict[str, Any], memory: int) -> dict[str, Any]:
    told = {key: card[key] for key in ("title", "description", "source", "licence") if key in card}
    return told | {"memory_MiB": round(memory / 2**20, 1)}


def _facts_table(known: dict[str, Any]) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, show_header=False)
    table.add_column(no_wrap=True, style="dim")
    table.add_column(overflow="fold")
    for key, value in known.items():
        if isinstance(value, dict):
            for inner, entry in value.items():
                table.add_row(_words(f"{key} {inner}"), _text(entry))
        elif value not in (None, "", []):
            table.add_row(_words(key), _text(value))
    return table


def _stations_table(subject: Subject, found: Measurement) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False)
    heads = (
        "downwind, m",
        f"mean, {subject.unit}",
        f"peak, {subject.unit}",
        "intermittency",
        "std / mean",
        "whiffs / min",
    )
    for head in heads:
        table.add_column(head, justify="right")
    for station in found.stations:
        shares = (station.intermittency, station.variation, station.whiffs)
        figures = (station.distance, station.mean, station.peak, *shares)
        table.add_row(*("-" if figure is None else f"{figure:.3g}" for figure in figures))
    return table


def _wind_table(found: Measurement) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False)
    for head in ("wind, m/s", "u", "v", "w"):
        table.add_column(head, justify="right" if len(head) == 1 else "left")
    table.add_row("mean", *(f"{value + 0.0:.3f}" for value in found.mean_wind))
    table.add_row("rms", *(f"{value:.3f}" for value in found.wind_rms))
    table.add_row("largest speed", f"{found.largest_wind:.3f}")
    return table


def _rule(found: Measurement) -> str:
    if found.samples == 1:
        return "The plume does not change in time: the mean is all there is."
    level = "a tenth of the mean there" if found.threshold is None else f"{found.threshold:g} {found.unit}"
    return f"{found.samples} samples over {found.seconds:g} s; intermittency and whiffs: above {level}."


def _words(key: str) -> str:
    """`mean_m_s` as "mean, m/s", `duration_s` as "duration, s"."""
    for ending, unit in (("_m_s", "m/s"), ("_s", "s"), ("_m", "m"), ("_MiB", "MiB")):
        if key.endswith(ending):
            return f"{key.removesuffix(ending).replace('_', ' ')}, {unit}"
    return key.replace("_", " ")


def _text(value: Any) -> str:
    if isinstance(value, list):
        return (
            " x ".join(_text(entry) for entry in value)
            if value and isinstance(value[0], int)
            else ", ".join(f"({_text(entry)})" if isinstance(entry, list) else _text(entry) for entry in value)
        )
    return f"{value:.4g}" if isinstance(value, float) else str(value)
