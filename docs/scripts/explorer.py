"""Records the explorer in out/explorer: its stories at two widths, and 20 seconds of its use.

Also draws docs/explorer.png.
"""

import io
import math
import shutil
from pathlib import Path

from pages import DOCS
from PIL import Image
from playwright.sync_api import sync_playwright

from ca_ros.explore import PAGE

OUT = Path('out/explorer')
FLAGS = ['--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader']
RATE = 10  # pictures a second of the recording

POINTER = """() => {
  const dot = document.createElement('div');
  dot.style = 'position:fixed;width:18px;height:18px;margin:-9px;border-radius:50%;z-index:9;' +
    'background:#d55e0088;border:2px solid #d55e00;pointer-events:none';
  document.body.append(dot);
  addEventListener('mousemove', (event) => {
    dot.style.left = `${event.clientX}px`; dot.style.top = `${event.clientY}px`; }, true);
}"""


def opened(browser, width, height, scheme='light', story=''):
    """Return the page, with one of its stories."""
    page = browser.new_page(viewport={'width': width, 'height': height}, color_scheme=scheme)
    page.goto(PAGE.as_uri())
    page.wait_for_function('window.explorer?.times.length')
    if story:
        page.locator(f'#story button[value={story}]').click()
    page.wait_for_timeout(500)
    return page


class Recording:
    """Takes a picture after each small movement of the pointer."""

    def __init__(self, page):
        self.page, self.pictures, self.at = page, [], (640.0, 60.0)
        page.evaluate(POINTER)

    def wait(self, seconds):
        for _ in range(round(seconds * RATE)):
            shot = self.page.screenshot(type='jpeg', quality=95)
            picture = Image.open(io.BytesIO(shot))
            self.pictures.append(picture.resize((960, 600), Image.Resampling.LANCZOS))

    def move(self, x, y, seconds=1.0):
        (x0, y0), steps = self.at, max(1, round(seconds * RATE))
        for i in range(1, steps + 1):
            share = 0.5 - 0.5 * math.cos(math.pi * i / steps)
            self.page.mouse.move(x0 + share * (x - x0), y0 + share * (y - y0))
            self.wait(1.0 / RATE)
        self.at = x, y

    def drag(self, *path, seconds=1.0):
        self.page.mouse.down()
        for x, y in path:
            self.move(x, y, seconds)
        self.page.mouse.up()

    def to(self, selector):
        box = self.page.locator(selector).first.bounding_box()
        self.move(box['x'] + box['width'] / 2, box['y'] + box['height'] / 2)


def click(film, selector):
    """Move to an element, and press it."""
    film.to(selector)
    film.page.mouse.down()
    film.page.mouse.up()


def record(page):
    """Drag the demand, see what a lost rotor costs, and fly."""
    film = Recording(page)
    film.wait(1.0)
    film.to('#section .ring')
    x, y = film.at
    film.drag((x - 90, y - 90), (x - 150, y + 30), (x, y))
    film.wait(0.5)
    click(film, '#story button[value=lost]')
    film.wait(2.5)
    page.evaluate('document.querySelector("#flight").scrollIntoView()')
    page.select_option('#begin', 'over')
    click(film, '#fly')
    film.wait(6.5)
    return film.pictures


def main():
    """Write the screenshots and the recording."""
    OUT.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as playwright:
        program = shutil.which('chromium') or shutil.which('chromium-browser')
        browser = playwright.chromium.launch(executable_path=program, args=FLAGS)
        for width, height in ((1280, 900), (390, 844)):
            for scheme in ('light', 'dark'):
                for story in ('roll', 'lost', 'airmode', 'missed', 'px4'):
                    page = opened(browser, width, height, scheme, story)
                    page.screenshot(path=OUT / f'{story}_{width}_{scheme}.png')
                    page.close()
        first, *others = record(opened(browser, 1280, 800))
        browser.close()
    first.save(OUT / 'explorer.webp', save_all=True, append_images=others, loop=0,
               duration=round(1000 / RATE))
    picture = Image.open(OUT / 'lost_1280_light.png').convert('RGB')
    picture.quantize(256, Image.Quantize.MEDIANCUT).save(DOCS / 'explorer.png')
    print(f'Written: {OUT}, {(1 + len(others)) / RATE:g} s')


if __name__ == '__main__':
    main()
