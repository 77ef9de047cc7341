"""`osl plume`: a plume or a field as a picture, in numbers, from another program's files, and into them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from osl_env.errors import InputError
from training.commands.options import Count, Pairs, check_count, print_json
from training.commands.plume_files import Export, Import
from training.commands.plume_options import (
    Name,
    OptionalSeconds,
    Output,
    Seconds,
    check_times,
    named_subject,
    progress_bar,
    say_written,
)

_MAX_FRAMES = 1000


@dataclass(frozen=True)
class Show:
    """Draw a plume: slices through its source as a picture (.png) and an animation (.gif)."""

    name: Name
    """a scenario, or a field: a name from `osl list` (NAME.npz: the field of that name), a YAML or an .npz file"""
    seconds: OptionalSeconds = None
    """that the animation covers; by default the wind's way through the area"""
    frames: Count = 60
    """pictures in the animation"""
    fps: Annotated[float, tyro.conf.arg(metavar="N")] = 10.0
    """pictures a second when it is played"""
    no_animation: bool = False
    """the picture only"""
    output: Output = None
    """for the files; results/plumes/NAME by default"""
    seed: Count = 0
    """of the episode"""
    set: Pairs = ()
    """change the scenario: wind.velocity=[1,0,0]"""
    json: bool = False
    """print JSON only"""

    def execute(self) -> None:
        """Draw and write. Raises InputError for any bad argument before anything is simulated."""
        check_times(seconds=self.seconds, fps=self.fps)
        check_count("frames", self.frames)
        if self.frames > _MAX_FRAMES or self.fps > 50:
            raise InputError(f"--frames {self.frames} --fps {self.fps:g}: at most {_MAX_FRAMES} frames, 50 a second")
        subject = named_subject(self.name, self.seed, self.set)
        folder = self.output or Path("results") / "plumes" / Path(self.name).stem
        from training.records import check_output

        paths = [folder / "picture.png"] + ([] if self.no_animation else [folder / "animation.gif"])
        for path in paths:
            check_output(path, (".png", ".gif"))
        from training.figures import save
        from training.plume_pictures import Picture, moments, page, write_gif

        subject.go_on(subject.development)
        picture = Picture(subject)
        save(picture.figure, paths[0])
        if not self.no_animation:
            seconds = self.seconds or subject.crossing_time
            with progress_bar(self.frames, "frame", self.json) as bar:
                pages = []
                for _ in moments(picture, seconds, self.frames):
                    pages.append(page(picture.figure))
                    bar.update()
            write_gif(pages, paths[1], self.fps)
        say_written(paths, self.json)


@dataclass(frozen=True)
class Stats:
    """A plume in numbers: readings downwind of the source, the wind, and what a field holds."""

    name: Name
    """a scenario, or a field: a name from `osl list`, a YAML or an .npz file"""
    seconds: Seconds = 300.0
    """over which it is sampled"""
    interval: Seconds = 0.5
    """between two samples"""
    seed: Count = 0
    """of the episode"""
    set: Pairs = ()
    """change the scenario: wind.velocity=[1,0,0]"""
    json: bool = False
    """print JSON only"""

    def execute(self) -> None:
        """Measure and print. Raises InputError for any bad argument before anything is simulated."""
        check_times(seconds=self.seconds, interval=self.interval)
        if not self.interval < self.seconds or self.seconds / self.interval > 1e6:
            raise InputError(f"--interval {self.interval:g}: must lie between a millionth of --seconds and --seconds")
        subject = named_subject(self.name, self.seed, self.set)
        from training.plume_report import facts, tables
        from training.plume_statistics import measure

        subject.go_on(subject.development)
        samples = round(self.seconds / self.interval) if subject.changes else 1
        with progress_bar(samples, "sample", self.json) as bar:
            found = measure(subject, self.seconds, self.interval, subject.threshold, bar.update)
        about = facts(subject)
        if self.json:
            print_json({"name": subject.name, "facts": about, **found.to_dict()})
            return
        from training.report import console

        screen = console()
        for part in tables(subject, about, found):
            screen.print(part)


@dataclass(frozen=True)
class Plume:
    """Show, measure, import and export plumes and fields."""

    action: tyro.conf.OmitSubcommandPrefixes[
        Annotated[Show, tyro.conf.subcommand("show")]
        | Annotated[Stats, tyro.conf.subcommand("stats")]
        | Annotated[Import, tyro.conf.subcommand("import")]
        | Annotated[Export, tyro.conf.subcommand("export")]
    ]

    def execute(self) -> None:
        """Do it. Raises InputError for any bad argument."""
        self.action.execute()
