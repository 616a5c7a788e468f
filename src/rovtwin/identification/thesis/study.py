"""Everything of the thesis that can be derived again, in its order."""

from collections.abc import Callable
from dataclasses import dataclass

from rovtwin.identification.thesis.comparison import comparison_section
from rovtwin.identification.thesis.decay import decay_section
from rovtwin.identification.thesis.empirical import empirical_section
from rovtwin.identification.thesis.found import Line, Section
from rovtwin.identification.thesis.free_running import added_mass_section, damping_section
from rovtwin.identification.thesis.simulation import simulation_section

SECTIONS: tuple[Callable[[], Section], ...] = (
    empirical_section,
    damping_section,
    added_mass_section,
    decay_section,
    comparison_section,
    simulation_section,
)


@dataclass(frozen=True)
class Study:
    """Published, derived and corrected results of the thesis, section by section."""

    sections: tuple[Section, ...]

    def line(self, section: str, name: str) -> Line:
        """A line by the key of its section and its name. Raises KeyError where there is none."""
        for one in self.sections:
            for line in one.lines:
                if (one.key, line.name) == (section, name):
                    return line
        raise KeyError((section, name))


def rederive(progress: Callable[[str], None] | None = None) -> Study:
    """Derive every identification result of the thesis again; `progress` gets the title of each section done."""
    sections = []
    for make in SECTIONS:
        section = make()
        sections.append(section)
        if progress is not None:
            progress(section.title)
    return Study(tuple(sections))
