"""Records the explorer in out/explorer: screenshots at two widths, and 20 seconds of its use.

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
CASE = '#vehicle=hexarotor&demand=9.81,1.7,-0.9,0&health=0,1,1,1,1,1&beside=pseudo_inverse'
RATE = 10  # pictures a second of the recording

POINTER = """() => {
  const dot = document.createElement('div');
  dot.style = 'position:fixed;width:18px;height:18px;margin:-9px;border-radius:50%;z-index:9;' +
    'background:#d55e0088;border:2px solid #d55e00;pointer-events:none';
  document.body.append(dot);
  addEventListener('mousemove', (event) => {
    dot.style.left = `${event.clientX}px`; dot.style.top = `${event.clientY}px`; }, true);
}"""


def opened(browser, width, height, scheme='light', case=''):
    """Return a page that shows a case."""
    page = browser.new_page(viewport={'width': width, 'height': height}, color_scheme=scheme)
    page.goto(PAGE.as_uri() + case)
    page.wait_for_function('window.explorer?.times.length')
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


DEMAND = """() => {
  const box = document.querySelector('#set').getBoundingClientRect();
  return [box.x, box.y, box.width, box.height];
}"""


def record(page):
    """Drag the demand out of the set, fail a rotor, compare, look at a section and the X8."""
    film = Recording(page)
    x, y, w, h = page.evaluate(DEMAND)
    middle = x + w / 2, y + h / 2
    film.wait(0.5)
    film.move(*middle)
    film.drag((middle[0] + 95, middle[1] - 30), (middle[0] + 190, middle[1] - 10), middle)
    film.move(x + 40, y + h - 40, 0.5)
    film.drag((x + 150, y + h - 70), seconds=1.5)
    film.to('#rotors div:nth-child(1) button')
    page.mouse.down()
    page.mouse.up()
    film.wait(1.5)
    page.select_option('#beside', 'pseudo_inverse')
    film.to('#shown button[value="roll,pitch"]')
    page.mouse.down()
    page.mouse.up()
    film.wait(0.7)
    film.move(*middle)
    film.drag((middle[0] + 110, middle[1] - 60), (middle[0] - 40, middle[1] - 140),
              (middle[0] - 150, middle[1] + 20), middle)
    page.select_option('#vehicle', 'x8')
    film.wait(2.0)
    film.to('#rotors div:nth-child(3) button')
    page.mouse.down()
    page.mouse.up()
    film.wait(2.5)
    return film.pictures


def main():
    """Write the screenshots and the recording."""
    OUT.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as playwright:
        program = shutil.which('chromium') or shutil.which('chromium-browser')
        browser = playwright.chromium.launch(executable_path=program, args=FLAGS)
        for width, height in ((1280, 800), (390, 844)):
            for scheme in ('light', 'dark'):
                page = opened(browser, width, height, scheme, CASE)
                # The answer stays at the bottom of a narrow screen: show the set above it.
                narrow = width < 700
                if narrow:
                    page.evaluate('document.querySelector("section + section").scrollIntoView()')
                page.screenshot(path=OUT / f'{width}_{scheme}.png', full_page=not narrow)
                page.close()
        first, *others = record(opened(browser, 1280, 800))
        browser.close()
    first.save(OUT / 'explorer.webp', save_all=True, append_images=others, loop=0,
               duration=round(1000 / RATE))
    Image.open(OUT / '1280_light.png').convert('RGB').quantize(64).save(DOCS / 'explorer.png')
    print(f'Written: {OUT}, {(1 + len(others)) / RATE:g} s')


if __name__ == '__main__':
    main()
