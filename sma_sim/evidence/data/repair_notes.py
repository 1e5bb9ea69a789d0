"""What was repaired in the recordings of a campaign, each note once."""

from __future__ import annotations

from collections.abc import Sequence

from sma_sim.evidence.data.recording import Campaign

MAX_NAMES = 3


def grouped_notes(campaigns: Sequence[Campaign]) -> list[str]:
    """The notes of all recordings, equal ones joined, then those of the campaigns."""
    names: dict[str, list[str]] = {}
    for recording in (recording for campaign in campaigns for recording in campaign.recordings):
        for note in recording.notes:
            names.setdefault(note, []).append(recording.name)
    common = dict.fromkeys(note for campaign in campaigns for note in campaign.notes)
    return [*(f'{abbreviated_list(found)}: {note}' for note, found in names.items()), *common]


def abbreviated_list(names: Sequence[str]) -> str:
    """A few names, and how many more."""
    more = f' and {len(names) - MAX_NAMES} more' if len(names) > MAX_NAMES else ''
    return ', '.join(names[:MAX_NAMES]) + more
