# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""What the page's own modules make of shapes and pictures, in a browser."""

from __future__ import annotations

import base64

import cv2
import numpy as np

PLAIN_WISHES = {"opacity": 1, "layersOff": [], "labelsOff": []}


def decoded(screen, zipped):
    """Return shapes as the page reads them; each array as a list."""
    return screen.page.evaluate(_DECODE, base64.b64encode(zipped).decode())


def painted(screen, zipped, scale=2.0, ratio=1.0, skip_px=0, **wishes):
    """Return a picture (h, w, 3) BGR of the map on black, ``scale`` CSS pixels for one pixel."""
    wishes = {**PLAIN_WISHES, **wishes}
    options = {"scale": scale, "ratio": ratio, "skipPx": skip_px, "wishes": wishes}
    url = screen.page.evaluate(_PAINT, [base64.b64encode(zipped).decode(), options])
    data = np.frombuffer(base64.b64decode(url.partition(",")[2]), np.uint8)
    return cv2.imdecode(data, cv2.IMREAD_COLOR)


def looked(screen, grey, celsius=None, thermal=True, **look):
    """Return a grey picture (h, w) as the page colours it, (h, w, 3) BGR."""
    high, wide = grey.shape
    about = {"celsius": celsius, "thermal": thermal, "wide": wide, "high": high, "look": look}
    rows = screen.page.evaluate(_LOOK, [grey.ravel().tolist(), about])
    return np.array(rows, np.uint8).reshape(high, wide, 4)[:, :, 2::-1]


_DECODE = """async (coded) => {
  const { inflated, shapesOf } = await import("/static/js/video/shapes.js");
  const zipped = Uint8Array.from(atob(coded), (letter) => letter.charCodeAt(0));
  const shapes = shapesOf(await inflated(zipped));
  const runs = ({ layers, values, starts, points }) =>
    ({ layers: [...layers], values: [...values], starts: [...starts], points: [...points] });
  const [rings, lines, marks] = [shapes.rings, shapes.lines, shapes.marks].map(runs);
  return { ...shapes, rings, lines, marks };
}"""
_PAINT = """async ([coded, { scale, ratio, skipPx, wishes }]) => {
  const { inflated, shapesOf } = await import("/static/js/video/shapes.js");
  const { MapPainter, inkOf } = await import("/static/js/video/map_painter.js");
  const { PictureView } = await import("/static/js/video/view.js");
  const zipped = Uint8Array.from(atob(coded), (letter) => letter.charCodeAt(0));
  const shapes = shapesOf(await inflated(zipped));
  const view = new PictureView();
  const [width, height] = shapes.size.map((side) => side * scale);
  view.setPicture(...shapes.size);
  view.setBox(width, height);
  const canvas = document.createElement("canvas");
  Object.assign(canvas, { width: width * ratio, height: height * ratio });
  const context = canvas.getContext("2d", { alpha: false });
  const sheet = { context, view, ratio, taken: [], skipPx, ink: inkOf(width, height) };
  new MapPainter().paint(sheet, shapes, wishes);
  return canvas.toDataURL();
}"""
_LOOK = """async ([grey, { celsius, thermal, wide, high, look }]) => {
  const { Picture } = await import("/static/js/video/picture.js");
  const { PLAIN } = await import("/static/js/video/look_values.js");
  const image = new ImageData(wide, high);
  grey.forEach((value, k) => image.data.set([value, value, value, 255], 4 * k));
  const bitmap = await createImageBitmap(image);
  const frame = { stampNs: "1", width: wide, height: high, bitmap,
    shapes: { grey: thermal, celsius } };
  const canvas = document.createElement("canvas");
  Object.assign(canvas, { width: wide, height: high });
  const context = canvas.getContext("2d");
  context.drawImage(new Picture().of(frame, { ...PLAIN, ...look }), 0, 0);
  return [...context.getImageData(0, 0, wide, high).data];
}"""
