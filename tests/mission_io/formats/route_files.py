"""Files of routes as other programs write them, made from (latitude, longitude, height above home) and the height of home."""

Points = list[tuple[float, float, float]]


def gpx(points: Points, home_m: float) -> str:
    rows = "".join(f'<rtept lat="{lat}" lon="{lon}"><ele>{home_m + up}</ele></rtept>' for lat, lon, up in points)
    return f'<?xml version="1.0"?><gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1"><rte>{rows}</rte></gpx>'


def kml(points: Points, home_m: float) -> str:
    positions = "\n ".join(f"{lon},{lat},{home_m + up}" for lat, lon, up in points)
    return (
        '<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark><LineString>'
        f"<altitudeMode>absolute</altitudeMode><coordinates>{positions}</coordinates></LineString></Placemark></Document></kml>"
    )


def litchi(points: Points, home_m: float) -> str:
    assert home_m
    actions = ",".join(f"actiontype{n},actionparam{n}" for n in range(1, 16))
    position = "latitude,longitude,altitude(m),heading(deg),curvesize(m),rotationdir,gimbalmode,gimbalpitchangle"
    head = f"{position},{actions},altitudemode,speed(m/s)"
    rows = [f"{lat},{lon},{up},90,0,0,0,0,{','.join(['-1,0'] * 15)},0,7.5" for lat, lon, up in points]
    return "\n".join([head, *rows])


def wpml(points: Points, home_m: float) -> str:
    assert home_m
    marks = "".join(
        f"<Placemark><Point><coordinates>{lon},{lat}</coordinates></Point><wpml:index>{n}</wpml:index>"
        f"<wpml:executeHeight>{up}</wpml:executeHeight><wpml:waypointSpeed>7.5</wpml:waypointSpeed></Placemark>"
        for n, (lat, lon, up) in enumerate(points)
    )
    return (
        '<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2" xmlns:wpml="http://www.dji.com/wpmz/1.0.6"><Document>'
        "<wpml:missionConfig><wpml:finishAction>goHome</wpml:finishAction><wpml:takeOffSecurityHeight>20</wpml:takeOffSecurityHeight>"
        "<wpml:globalRTHHeight>88</wpml:globalRTHHeight></wpml:missionConfig><Folder>"
        "<wpml:executeHeightMode>relativeToStartPoint</wpml:executeHeightMode><wpml:autoFlightSpeed>5</wpml:autoFlightSpeed>"
        f"{marks}</Folder></Document></kml>"
    )


ROUTES = {".gpx": gpx, ".kml": kml, ".csv": litchi, ".wpml": wpml}
