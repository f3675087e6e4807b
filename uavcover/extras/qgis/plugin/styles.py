"""Styles of the output layers. Each is kept in a .qml file beside its layer, which QGIS applies whenever the layer is opened."""

import json
import os

from qgis.core import (
    QgsCategorizedSymbolRenderer,
    QgsFillSymbol,
    QgsLineSymbol,
    QgsMarkerSymbol,
    QgsPalettedRasterRenderer,
    QgsRasterLayer,
    QgsRendererCategory,
    QgsSingleSymbolRenderer,
    QgsVectorLayer,
)
from qgis.PyQt.QtGui import QColor

ROUTE, GREEN, ORANGE, RED = "#1a1a8c", "#009e73", "#d55e00", "#e00000"
REASON_BAND = {"coverage.tif": 7, "photos.tif": 6}
REASONS = (
    ("observed", GREEN), ("never in range and field of view", ORANGE), ("view too oblique", "#cc79a7"),
    ("hidden by terrain or obstacles", "#7f3b08"), ("outside the flight limits", "#999999"),
    ("ground sample distance too large", "#e6c700"), ("too few observations", "#56b4e9"), ("attitude unknown", "#555555"),
)  # fmt: skip


def line(color, width="0.7", style="solid"):
    return QgsLineSymbol.createSimple({"line_color": color, "line_width": width, "line_style": style})


def marker(color, name="circle", size="2.6"):
    return QgsMarkerSymbol.createSimple({"color": color, "name": name, "size": size, "outline_color": "#ffffff"})


def fill(color, outline):
    return QgsFillSymbol.createSimple({"color": color, "outline_color": outline, "outline_width": "0.3"})


def by_value(field, rows):
    """A renderer with a symbol for each value of a field, and the last one for all others."""
    categories = [QgsRendererCategory(value, symbol, label) for value, symbol, label in rows]
    return QgsCategorizedSymbolRenderer(field, categories)


def route(layer):
    layer.setRenderer(QgsSingleSymbolRenderer(line(ROUTE)))


def waypoints(layer):
    layer.setRenderer(QgsSingleSymbolRenderer(marker("#ffffff")))
    layer.renderer().symbol().symbolLayer(0).setStrokeColor(QColor(ROUTE))


def legs(layer):
    """Legs in red where a finding is, orange where one needs a look; transit dashed."""
    layer.setRenderer(
        by_value(
            "shown",
            [
                ("breaks", line(RED, "1.1"), "violates a limit"), ("look", line(ORANGE, "1.1"), "needs attention"),
                ("transit", line("#555555", "0.5", "dash"), "transit, take-off, landing"), (None, line(ROUTE), "no finding"),
            ],
        )
    )  # fmt: skip


def findings(layer):
    layer.setRenderer(
        by_value(
            "weight",
            [("breaks", marker(RED, "triangle", "3.6"), "violates a limit"), (None, marker(ORANGE, "triangle", "3.2"), "needs attention")],
        )
    )  # fmt: skip


def footprints(layer):
    layer.setRenderer(QgsSingleSymbolRenderer(fill("0,114,95,15", "#00725f")))


def gaps(layer):
    layer.setRenderer(QgsSingleSymbolRenderer(fill("213,94,0,170", ORANGE)))


def missing(layer):
    layer.setRenderer(QgsSingleSymbolRenderer(line(RED, "1.1")))


def coverage(layer):
    """Reasons why cells were not observed; observed cells in green."""
    classes = [
        QgsPalettedRasterRenderer.Class(number, QColor(color), label) for number, (label, color) in enumerate(REASONS)
    ]
    band = REASON_BAND[os.path.basename(layer.source())]
    layer.setRenderer(QgsPalettedRasterRenderer(layer.dataProvider(), band, classes))
    layer.setOpacity(0.7)


def keep(path, style):
    """Write the style of a layer beside its file; False where the file is no layer."""
    is_raster = path.endswith(".tif")
    layer = QgsRasterLayer(path) if is_raster else QgsVectorLayer(path, "", "ogr")
    if not layer.isValid():
        return False
    style(layer)
    layer.saveNamedStyle(os.path.splitext(path)[0] + ".qml")
    return True


def split(path, kinds, more):
    """Move the features of other geometries than ``kinds`` to a file of their own: a layer of QGIS has one kind.

    Returns:
        the path of the others; None where there are none.
    """
    with open(path, encoding="utf-8") as file:
        document = json.load(file)
    others = [each for each in document["features"] if each["geometry"]["type"] not in kinds]
    document["features"] = [each for each in document["features"] if each["geometry"]["type"] in kinds]
    write(path, document)
    if not others:
        return None
    stem, suffix = os.path.splitext(path)
    write(f"{stem}-{more}{suffix}", {**document, "features": others})
    return f"{stem}-{more}{suffix}"


def write(path, document):
    with open(path, "w", encoding="utf-8") as file:
        json.dump(document, file)


def mark_legs(path, found):
    """Label each leg with its finding."""
    with open(path, encoding="utf-8") as file:
        document = json.load(file)
    for leg in document["features"]:
        own = leg["properties"]
        item = own.get("item", -1)
        about = [each for each in found if each.get("items") and each["items"][0] <= item <= each["items"][1]]
        weights = {"breaks" if each.get("weight") == "breaks" else "look" for each in about}
        phase = "" if own.get("phase") == "route" else "transit"
        own["shown"] = "breaks" if "breaks" in weights else "look" if weights else phase
        own["findings"] = "; ".join(str(each.get("what")) for each in about)
    write(path, document)
