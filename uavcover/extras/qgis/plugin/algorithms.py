"""The algorithms: layers and files in, files and layers out, by the commands of uavcover."""

import json
import os

from qgis.core import (
    QgsCoordinateReferenceSystem,
    QgsCoordinateTransform,
    QgsProcessing,
    QgsProcessingAlgorithm,
    QgsProcessingContext,
    QgsProcessingException,
    QgsProcessingOutputRasterLayer,
    QgsProcessingParameterEnum,
    QgsProcessingParameterFile,
    QgsProcessingParameterFileDestination,
    QgsProcessingParameterFolderDestination,
    QgsProcessingParameterRasterLayer,
    QgsProcessingParameterString,
    QgsProcessingParameterVectorLayer,
    QgsProject,
)

from . import styles
from .program import PROGRAM
from .runner import UavcoverError, find_program, run

FORMATS = ["plan", "waypoints", "kml", "geojson", "csv", "gpx", "wpml", "litchi"]


class UavcoverAlgorithm(QgsProcessingAlgorithm):
    """Base of the algorithms."""

    NAME = TITLE = HELP = ""

    def createInstance(self):
        return type(self)()

    def name(self):
        return self.NAME

    def displayName(self):
        return self.TITLE

    def shortHelpString(self):
        return self.HELP

    def uavcover(self, arguments, feedback, accepted=(0, 1)):
        """Run a command; its error becomes one of Processing."""
        try:
            return run(find_program(PROGRAM, os.environ.get("UAVCOVER")), arguments, feedback, accepted)
        except UavcoverError as error:
            raise QgsProcessingException(str(error)) from error

    def area_file(self, layer, scenario):
        """The polygons of a layer as a GeoJSON file in longitude and latitude, beside the scenario, which names it."""
        wgs84 = QgsCoordinateReferenceSystem("EPSG:4326")
        features = []
        for feature in layer.getFeatures():
            geometry = feature.geometry()
            geometry.transform(QgsCoordinateTransform(layer.crs(), wgs84, QgsProject.instance().transformContext()))
            features.append({"type": "Feature", "properties": {}, "geometry": json.loads(geometry.asJson(9))})
        stem, number = os.path.splitext(scenario)[0], 1
        path = stem + "-area.geojson"
        while os.path.exists(path):
            number += 1
            path = f"{stem}-area-{number}.geojson"
        with open(path, "w", encoding="utf-8") as file:
            json.dump({"type": "FeatureCollection", "features": features}, file)
        return path

    def text(self, parameters, name, context):
        return self.parameterAsString(parameters, name, context).strip()

    def options(self, parameters, context, names):
        """``--name value`` for each text that was given."""
        words = []
        for name in names:
            value = self.text(parameters, name.upper().replace("-", "_"), context)
            if value:
                words += [f"--{name}", value]
        return words


def load(context, path, title, style):
    """Style a file, and show it as a layer when the algorithm has ended."""
    if path and os.path.isfile(path) and styles.keep(path, style):
        context.addLayerToLoadOnCompletion(path, QgsProcessingContext.LayerDetails(title, context.project(), title))


def optional(name, label, default=""):
    """An optional text."""
    return QgsProcessingParameterString(name, label, default, optional=True)


class NewAlgorithm(UavcoverAlgorithm):
    """From an area, elevation data and a camera to a scenario."""

    NAME, TITLE = "new", "New survey scenario"
    HELP = "Writes a scenario for an area layer, elevation data and a camera, as the command uavcover new does."

    def initAlgorithm(self, config=None):
        self.addParameter(QgsProcessingParameterVectorLayer("AREA", "Area", [QgsProcessing.TypeVectorPolygon]))
        self.addParameter(QgsProcessingParameterRasterLayer("DEM", "Elevation data"))
        self.addParameter(optional("VERTICAL_DATUM", "Vertical datum (EGM96, EGM2008, ellipsoid)"))
        self.addParameter(QgsProcessingParameterString("CAMERA", "Camera (uavcover new --camera list)", "dji-m3e"))
        self.addParameter(QgsProcessingParameterString("GSD", "Ground sample distance", "3cm"))
        for name, label in (
            ("OVERLAP", "Overlap, forward/side, such as 75/70"), ("VEHICLE", "Vehicle"), ("BATTERY", "Flight time, "
                                                                                                     "such as 25min"),
            ("MAX_HEIGHT", "Maximum height above ground, such as 120m"), ("SPEED", "Speed, such as 10m/s"), ("HOME", "Take-off, LAT,LON"),
        ):  # fmt: skip
            self.addParameter(optional(name, label))
        self.addParameter(QgsProcessingParameterFileDestination("SCENARIO", "Scenario", "TOML (*.toml)"))

    def processAlgorithm(self, parameters, context, feedback):
        out = self.parameterAsFileOutput(parameters, "SCENARIO", context)
        area = self.area_file(self.parameterAsVectorLayer(parameters, "AREA", context), out)
        dem = self.parameterAsRasterLayer(parameters, "DEM", context).source()
        names = ("camera", "gsd", "overlap", "vehicle", "battery", "max-height", "speed", "home", "vertical-datum")
        self.uavcover(
            ["new", area, "--dem", dem, *self.options(parameters, context, names), "-o", out, "--force"], feedback
        )
        return {"SCENARIO": out}


class PlanAlgorithm(UavcoverAlgorithm):
    """From a scenario to a run folder with mission files, and the route as a layer."""

    NAME, TITLE = "plan", "Plan route"
    HELP = "Plans a scenario and writes the mission files to a run folder. Cancel to keep the best route found so far."

    def initAlgorithm(self, config=None):
        self.addParameter(QgsProcessingParameterFile("SCENARIO", "Scenario", extension="toml"))
        self.addParameter(optional("BUDGET", "Search time, such as 30s", "30s"))
        for name, label in (
            ("EVALUATIONS", "Number of evaluations, instead of a time"),
            ("SEED", "Seed"),
            ("SELECT", "Selection rule, such as coverage>=0.98"),
        ):
            self.addParameter(optional(name, label))
        self.addParameter(QgsProcessingParameterFolderDestination("RUN", "Run folder"))
        self.addParameter(QgsProcessingParameterFileDestination("ROUTE", "Route", "GeoJSON (*.geojson)"))

    def processAlgorithm(self, parameters, context, feedback):
        run_folder = self.parameterAsString(parameters, "RUN", context)
        evaluations = self.text(parameters, "EVALUATIONS", context)
        names = ("evaluations" if evaluations else "budget", "seed", "select")
        scenario = self.parameterAsFile(parameters, "SCENARIO", context)
        plan = self.uavcover(
            ["plan", scenario, "-o", run_folder, *self.options(parameters, context, names), "--force"],
            feedback,
            (0, 1, 130),
        )
        route = self.parameterAsFileOutput(parameters, "ROUTE", context)
        written = self.uavcover(["export", run_folder, "--format", "geojson", "-o", route, "--force"], feedback)
        for number, row in enumerate(written.get("files") or [{"file": route}], start=1):
            points = styles.split(row["file"], ("LineString",), "waypoints")
            load(context, row["file"], f"Route {number}", styles.route)
            load(context, points, f"Waypoints {number}", styles.waypoints)
        return {
            "RUN": run_folder,
            "ROUTE": route,
            "COVERAGE": plan.get("coverage_of_coverable"),
            "RULE_MET": plan.get("rule_met"),
        }


class CheckAlgorithm(UavcoverAlgorithm):
    """From anybody's mission file and elevation data to findings."""

    NAME, TITLE = "check", "Check mission"
    HELP = "Checks a mission from any ground station against the terrain, along the full length of every leg."

    def initAlgorithm(self, config=None):
        self.addParameter(QgsProcessingParameterFile("MISSION", "Mission file"))
        self.addParameter(QgsProcessingParameterRasterLayer("DEM", "Elevation data"))
        self.addParameter(optional("VERTICAL_DATUM", "Vertical datum (EGM96, EGM2008, ellipsoid)"))
        self.addParameter(QgsProcessingParameterFileDestination("FINDINGS", "Findings", "GeoJSON (*.geojson)"))

    def processAlgorithm(self, parameters, context, feedback):
        mission = self.parameterAsFile(parameters, "MISSION", context)
        dem = self.parameterAsRasterLayer(parameters, "DEM", context).source()
        found = self.parameterAsFileOutput(parameters, "FINDINGS", context)
        words = [
            "check",
            mission,
            "--dem",
            dem,
            *self.options(parameters, context, ("vertical-datum",)),
            "--map",
            found,
            "--force",
        ]
        document = self.uavcover(words, feedback)
        if os.path.isfile(found):
            legs = styles.split(found, ("Point",), "legs")
            if legs:
                styles.mark_legs(legs, document.get("findings") or ())
            load(context, legs, "Legs with findings", styles.legs)
            load(context, found, "Findings", styles.findings)
        return {"FINDINGS": found, "VERDICT": document.get("verdict")}


class VerifyAlgorithm(UavcoverAlgorithm):
    """From a run folder and a log to a verdict, coverage and gaps."""

    NAME, TITLE = "verify", "Verify flight"
    HELP = "Computes coverage and safety from the flown track of a run folder, or from a flight log."

    def initAlgorithm(self, config=None):
        self.addParameter(QgsProcessingParameterFile("RUN", "Run folder", behavior=QgsProcessingParameterFile.Folder))
        self.addParameter(
            QgsProcessingParameterFile("LOG", "Flight log, instead of the track of the run", optional=True)
        )
        self.addOutput(QgsProcessingOutputRasterLayer("COVERAGE", "Coverage"))

    def processAlgorithm(self, parameters, context, feedback):
        run_folder = self.parameterAsFile(parameters, "RUN", context)
        log = self.parameterAsFile(parameters, "LOG", context)
        document = self.uavcover(["verify", run_folder, *(["--log", log] if log else [])], feedback)
        coverage = os.path.join(run_folder, "coverage.tif")
        load(context, coverage, "Coverage", styles.coverage)
        return {
            "COVERAGE": coverage,
            "VERDICT": document.get("verdict"),
            "SHARE": document.get("coverage_of_coverable"),
        }


class PhotosAlgorithm(UavcoverAlgorithm):
    """From photos and a scenario to overlap and gaps."""

    NAME, TITLE = "judgephotos", "Judge photos"
    HELP = "Counts the photos that show each point of the ground. Hidden ground does not count."

    def initAlgorithm(self, config=None):
        self.addParameter(
            QgsProcessingParameterFile("PHOTOS", "Folder with photos", behavior=QgsProcessingParameterFile.Folder)
        )
        self.addParameter(QgsProcessingParameterFile("SCENARIO", "Scenario file"))
        self.addParameter(QgsProcessingParameterFolderDestination("OUT", "Folder for the verdict"))

    def processAlgorithm(self, parameters, context, feedback):
        out = self.parameterAsString(parameters, "OUT", context)
        photos, scenario = (self.parameterAsFile(parameters, name, context) for name in ("PHOTOS", "SCENARIO"))
        document = self.uavcover(["judge-photos", photos, "--scenario", scenario, "-o", out, "--force"], feedback)
        gaps = os.path.join(out, "gaps.geojson")
        stretches = styles.split(gaps, ("Polygon", "MultiPolygon"), "stretches")
        load(context, os.path.join(out, "photos.tif"), "Ground covered by photos", styles.coverage)
        load(context, os.path.join(out, "footprints.geojson"), "Footprints", styles.footprints)
        load(context, gaps, "Gaps", styles.gaps)
        load(context, stretches, "Missing photos", styles.missing)
        return {"OUT": out, "VERDICT": document.get("verdict")}


class ExportAlgorithm(UavcoverAlgorithm):
    """From a run folder to a file for other software."""

    NAME, TITLE = "export", "Export mission"
    HELP = "Writes the mission of a run folder for QGroundControl, Mission Planner, DJI, Litchi and others."

    def initAlgorithm(self, config=None):
        self.addParameter(QgsProcessingParameterFile("RUN", "Run folder", behavior=QgsProcessingParameterFile.Folder))
        self.addParameter(QgsProcessingParameterEnum("FORMAT", "Format", FORMATS, defaultValue=0))
        self.addParameter(optional("DRONE", "Aircraft for wpml, such as dji-m3e"))
        self.addParameter(QgsProcessingParameterFileDestination("FILE", "File", "All files (*.*)"))

    def processAlgorithm(self, parameters, context, feedback):
        file_format = FORMATS[self.parameterAsEnum(parameters, "FORMAT", context)]
        out = self.parameterAsFileOutput(parameters, "FILE", context)
        run_folder = self.parameterAsFile(parameters, "RUN", context)
        drone = self.options(parameters, context, ("drone",))
        self.uavcover(["export", run_folder, "--format", file_format, *drone, "-o", out, "--force"], feedback)
        return {"FILE": out}


ALGORITHMS = (NewAlgorithm, PlanAlgorithm, CheckAlgorithm, VerifyAlgorithm, PhotosAlgorithm, ExportAlgorithm)
