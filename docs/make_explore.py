"""Pictures of the page of `sma-sim explore`, on the case of its tutorial: docs/figures/explore*.png.

python docs/make_explore.py

It needs chromium, chromedriver and selenium (the `test` extra). The picture of the page beside a robot is not among them.
"""

from __future__ import annotations

import io
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from PIL import Image

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test'))

from browser import open_browser
from explore_server import serving, until
from explore_steps import READY, begin, take

from sma_sim.workflow.data_request import DataRequest

FIGURES = Path(__file__).resolve().parent / 'figures'
CASE = '--seed 3 --kind gravity --effects 1 --forces --duration 30 --rate 10'
SETTLED = 1.0  # [s] after which nothing on the page moves
DRAW = 'const one = document.getElementById("drawn"); one.value = arguments[0]; one.dispatchEvent(new Event("change"));'
DRAWN = 'return smaExplore.recordings.charts.size > 0 && document.querySelector("#errors table") !== null'
POINT = """
const canvas = smaExplore.recordings.charts.get('run1|U_y').canvas, x = canvas.getBoundingClientRect().x + 150;
for (const kind of ['pointerdown', 'pointerup']) canvas.dispatchEvent(new PointerEvent(kind, { clientX: x, bubbles: true }));
"""


def picture(browser: Any, name: str, top: str = '') -> None:
    """Keep what the window shows, with the element `top`, if one is named, below the page's head."""
    where = f'document.querySelector("{top}").getBoundingClientRect().top + scrollY - 60' if top else '0'
    browser.execute_script(f'document.activeElement.blur(); scrollTo(0, {where});')
    time.sleep(SETTLED)
    shown = Image.open(io.BytesIO(browser.get_screenshot_as_png())).convert('RGB')
    shown.quantize(128, dither=Image.Dither.NONE).save(FIGURES / f'{name}.png', optimize=True)


def main() -> None:
    """The way of the tutorial, with a picture at each of its places."""
    with tempfile.TemporaryDirectory() as folder:
        case = Path(folder) / 'case'
        subprocess.run(
            [sys.executable, '-m', 'sma_sim.cli.main', 'challenge', 'new', *CASE.split(), '--out', str(case)], check=True
        )
        data = DataRequest((case,), hold_out=('run3',))
        with serving(Path(folder) / 'session', config=case / 'nominal.yaml', data=data) as server:
            browser = open_browser(1360, 1000)
            try:
                browser.get(server.address)
                until(browser, READY)
                follow_the_tutorial(browser)
            finally:
                browser.quit()


def follow_the_tutorial(browser: Any) -> None:
    """Check, compare, look at a part of the error, diagnose, accept."""
    for stage in ('check', 'compare'):
        take(browser, stage)
    until(browser, DRAWN)
    picture(browser, 'explore_comparison')
    begin(browser, 'candidates')
    until(browser, 'return smaExplore.state.steps.candidates?.state === "done"')
    browser.execute_script(DRAW, 'residuals')
    until(browser, 'return [...smaExplore.recordings.charts.values()].every((chart) => chart.shade)')
    browser.execute_script(POINT)
    until(browser, 'return document.querySelectorAll("#region table").length === 2')
    picture(browser, 'explore_region', '#region')
    browser.execute_script(DRAW, 'curves')
    take(browser, 'diagnose')
    picture(browser, 'explore_diagnosis')
    begin(browser, 'accept')
    until(browser, 'return smaExplore.state.history.current === 2')
    take(browser, 'compare')
    picture(browser, 'explore_accepted')
    browser.find_element('id', 'view-model').click()
    browser.find_element('id', 'tab-effects').click()
    until(browser, 'return smaExplore.pictures > 0')
    picture(browser, 'explore')


if __name__ == '__main__':
    main()
