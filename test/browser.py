"""A headless browser for the tests of pages; the tests skip where there is none."""

import contextlib
import shutil

import pytest

DRIVER, BROWSER = shutil.which('chromedriver'), shutil.which('chromium') or shutil.which('google-chrome')


def open_browser(width=1400, height=900, phone=False, further=()):
    """A browser window of this size [px], with further options; skips the test where there is no browser."""
    webdriver = pytest.importorskip('selenium.webdriver', reason='selenium is not installed: pip install selenium')
    if not (DRIVER and BROWSER):
        pytest.skip('no browser: apt-get install chromium chromium-driver')
    options = webdriver.ChromeOptions()
    options.binary_location = BROWSER
    for word in (
        'headless=new',
        'no-sandbox',
        'disable-gpu',
        'disable-dev-shm-usage',
        f'window-size={width},{height}',
        *further,
    ):
        options.add_argument(f'--{word}')
    options.set_capability('goog:loggingPrefs', {'browser': 'ALL'})
    if phone:
        metrics = {'width': width, 'height': height, 'pixelRatio': 2.0, 'touch': True}
        options.add_experimental_option('mobileEmulation', {'deviceMetrics': metrics})
    return webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))


@contextlib.contextmanager
def silent_browser(width=1500, height=950):
    """A browser in whose console nothing stands at the end: no error, no warning."""
    one = open_browser(width, height)
    try:
        yield one
        assert one.get_log('browser') == []
    finally:
        one.quit()
