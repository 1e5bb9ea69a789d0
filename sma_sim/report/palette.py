"""Colours that colour-blind people tell apart, for figures and for RViz."""

from __future__ import annotations

# Okabe and Ito's colours
BLUE, ORANGE, GREEN, RED, GREY = '#0072B2', '#E69F00', '#009E73', '#D55E00', '#8c8c8c'
PURPLE, SKY = '#CC79A7', '#56B4E9'
MODE_COLOURS = {1: PURPLE, 2: BLUE, 3: '#c4c4c4', 4: SKY, 5: ORANGE}
MODE_NAMES = {
    1: '1 austenite',
    2: '2 martensite',
    3: '3 inside the hysteresis',
    4: '4 to martensite',
    5: '5 to austenite',
}
