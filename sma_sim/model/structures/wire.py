"""One wire on a test bench that imposes its strain."""

from sma_sim.model.parameters import PAPER
from sma_sim.model.structures.structure import Drive, Structure

STRUCTURE = Structure(
    name='wire',
    title='bench',
    coordinates=(),
    wires=1,
    drives=(Drive('strain', '-', 'strain of the wire', bounds=(-0.5, 0.5)),),
    description='a tensile machine stretches the wire; heated by J, cooled by air',
    source=PAPER,
)
