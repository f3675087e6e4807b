"""The provider of the algorithms, and the plugin that adds it."""

from qgis.core import QgsApplication, QgsProcessingProvider

from .algorithms import ALGORITHMS


class UavcoverProvider(QgsProcessingProvider):
    """All algorithms of uavcover."""

    def loadAlgorithms(self):
        for algorithm in ALGORITHMS:
            self.addAlgorithm(algorithm())

    def id(self):
        return "uavcover"

    def name(self):
        return "uavcover"


class UavcoverPlugin:
    """Adds the provider when QGIS starts, and removes it when it ends."""

    def __init__(self, iface):
        self.iface = iface
        self.provider = None

    def initProcessing(self):
        self.provider = UavcoverProvider()
        QgsApplication.processingRegistry().addProvider(self.provider)

    def initGui(self):
        self.initProcessing()

    def unload(self):
        QgsApplication.processingRegistry().removeProvider(self.provider)
