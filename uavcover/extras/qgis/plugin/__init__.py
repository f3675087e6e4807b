"""Plugin for QGIS: Processing algorithms that run the program uavcover."""


def classFactory(iface):
    """The plugin, as QGIS loads it; ``iface`` is None in qgis_process."""
    from .provider import UavcoverPlugin

    return UavcoverPlugin(iface)
