"""What literature calls usual of wires, by material and surroundings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

Range = tuple[float, float]
# Of all alloys: specific heat from 322 (Jackson, Wagner and Wasilewski, NASA-SP 5110, 1972) to 837 J/(kg K) (0.20 cal/(g K):
# Dynalloy, Technical characteristics of Flexinol, F1140 Rev I.2).
SPECIFIC_HEAT = (322.0, 837.0)
# Transformation temperatures tell the material where nobody has: austenite that is stable without load at room temperature
# is superelastic; martensite that forms above 100 deg C is a high-temperature alloy (Ma, Karaman and Noebe, Int. Mater. Rev.
# 55 (2010) 257); what is between is an actuator wire.
ROOM, HIGH = 298.0, 373.0  # [K]
# Nusselt numbers of thin horizontal cylinders, free convection in still air at the least, where wires of a bundle share
# their air, to a flow of water (Morgan, Adv. Heat Transfer 11 (1975) 199); conductivities [W/(m K)] at 300 K.
STILL_AIR, FLOWING_WATER = 0.15, 20.0
AIR_CONDUCTIVITY, WATER_CONDUCTIVITY = 0.026, 0.61


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


def material_of(p: Mapping[str, float], wires: int, given: str = '') -> Material | None:
    """The material that was `given`, else of a single wire the one that its transformation temperatures tell.

    `p`: parameters by full name. None of several wires: their nominal values are those of the robot.
    """
    if given:
        return MATERIALS[given]
    if wires != 1:
        return None
    to_martensite, to_austenite = (
        p['wire.T0'] - (p['wire.sigma_MW0'] + half * p['wire.dsigma']) / p['wire.sigma_T'] for half in (0.5, -0.5)
    )
    if to_martensite > HIGH:
        return MATERIALS['high-temperature']
    return MATERIALS['superelastic' if to_austenite < ROOM else 'actuator']


def usual_ranges(material: Material, p: Mapping[str, float]) -> dict[str, Range]:
    """The ranges [SI] of a material by parameter, with what does not depend on it; lambda by the radius among `p`."""
    return {**material.ranges, 'wire.c_V': SPECIFIC_HEAT, 'wire.lambda': usual_cooling(2.0 * p['wire.r0'])}


def usual_cooling(diameter: float) -> Range:
    """The range of the convective cooling coefficient [W/(m^2 K)] of a wire of this diameter [m]."""
    return STILL_AIR * AIR_CONDUCTIVITY / diameter, FLOWING_WATER * WATER_CONDUCTIVITY / diameter
