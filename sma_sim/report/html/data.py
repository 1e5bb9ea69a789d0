"""Section: what was measured, what was repaired on the way, and how noisy it is."""

from __future__ import annotations

from sma_sim.evidence.data.display_units import in_display_unit
from sma_sim.evidence.data.recording import Dataset
from sma_sim.report.html.page import Block, Bullets, Paragraph, Section, Table
from sma_sim.words.repair_notes import grouped_notes


def data_section(fitted: Dataset, held_out: Dataset | None) -> Section:
    """Recordings, noise, notes."""
    rows = [
        (
            recording.name,
            kind,
            f'{len(recording.time)}',
            f'{recording.time[-1] - recording.time[0]:.1f} s',
            ', '.join(recording.channels),
            'exact' if recording.exact_commands else 'sampled',
        )
        for dataset, kind in ((fitted, 'fitted'), (held_out, 'held out'))
        if dataset is not None
        for recording in dataset.recordings
    ]
    noise = ', '.join(f'{channel} {in_display_unit(channel, std)}' for channel, std in fitted.noise_std.items())
    notes = grouped_notes([part for part in (fitted, held_out) if part is not None])
    blocks: list[Block] = [
        Table(('recording', 'used', 'samples', 'length', 'channels', 'instants of commands'), rows),
        Paragraph(f'Noise (standard deviation): {noise}.'),
    ]
    return Section('Data', [*blocks, *([Bullets(notes)] if notes else [])])
