"""What literature calls usual of wires, by material."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

Range = tuple[float, float]
# Of all alloys: specific heat from 322 (Jackson, Wagner and Wasilewski, NASA-SP 5110, 1972) to 837 J/(kg K) (0.20 cal/(g K):
# Dynalloy, Technical characteristics of Flexinol, F1140 Rev I.2).
SPECIFIC_HEAT = (322.0, 837.0)


@dataclass(frozen=True)
class Material:
    """A kind of wire: what it is called in a sentence, and ranges [SI] by parameter of the wire."""

    words: str
    ranges: Mapping[str, Range]


MATERIALS: Mapping[str, Material] = {
    # Shaw and Kyriakides, J. Mech. Phys. Solids 43 (1995) 1243; Otsuka and Wayman, Shape Memory Materials (1998)
    'superelastic': Material(
        'superelastic NiTi',
        {
            'wire.E_A': (3e10, 9e10),
            'wire.E_M': (1.5e10, 5e10),
            'wire.eps_T': (0.02, 0.08),
            'wire.sigma_T': (4e6, 9e6),
            'wire.dsigma': (1e8, 4.5e8),
        },
    ),
    # SMA Inc., Selected properties of NiTi (about 83 and 28 to 41 GPa; 8 % in one cycle, 4 % in 100,000); Lagoudas,
    # Shape Memory Alloys (2008). sigma_T is rho ds/eps_T with an entropy ds of at most 0.105 J/(g K) (Resnina and Belyaev,
    # Thermochim. Acta 602 (2015) 30)
    'actuator': Material(
        'an actuator wire of NiTi',
        {
            'wire.E_A': (3e10, 9e10),
            'wire.E_M': (1.5e10, 4.5e10),
            'wire.eps_T': (0.02, 0.07),
            'wire.sigma_T': (4e6, 1e7),
            'wire.dsigma': (3e7, 3e8),
        },
    ),
    # Karaca et al., Mater. Sci. Technol. 30 (2014) 1530, and Acta Mater. 61 (2013) 7422 (up to 3.6 %); Bigelow et al.,
    # Materialia 21 (2022) 101297
    'high-temperature': Material(
        'a high-temperature alloy such as NiTiHf',
        {
            'wire.E_A': (3e10, 1.1e11),
            'wire.E_M': (1.5e10, 9e10),
            'wire.eps_T': (0.005, 0.05),
            'wire.sigma_T': (3e6, 1.6e7),
            'wire.dsigma': (1e8, 6e8),
        },
    ),
}


def usual_range(name: str) -> Range:
    """The range [SI] of a parameter of the wire, such as E_A, over all materials."""
    ends = [end for material in MATERIALS.values() for end in material.ranges[f'wire.{name}']]
    return min(ends), max(ends)
