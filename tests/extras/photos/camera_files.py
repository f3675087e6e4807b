"""Pictures as cameras write them, without anything in them: EXIF and XMP are what counts."""

from PIL import ExifTags, Image
from PIL.TiffImagePlugin import IFDRational

XMP = (
    '<?xpacket begin="" id="W5M0MpCehiHzreSzNTczkc9d"?><x:xmpmeta xmlns:x="adobe:ns:meta/">'
    '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description rdf:about="" {spaces} {attributes}/>'
    '</rdf:RDF></x:xmpmeta><?xpacket end="w"?>'
)
DJI = 'xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/"'


def dji(**values):
    return XMP.format(spaces=DJI, attributes=" ".join(f'drone-dji:{key}="{value}"' for key, value in values.items()))


def _sexagesimal(degrees):
    degrees = abs(degrees)
    whole = int(degrees)
    minutes = int(60 * (degrees - whole))
    seconds = 3600 * (degrees - whole) - 60 * minutes
    return (IFDRational(whole), IFDRational(minutes), IFDRational(round(seconds * 1_000_000), 1_000_000))


def write_jpeg(
    path,
    *,
    position=None,
    alt_m=None,
    below=0,
    time="2026:05:04 10:11:12",
    xmp=None,
    pixels=(5280, 3956),
    focal_mm=12.29,
    film_mm=24,
    exposure_s=0.001,
    model=("DJI", "M3E"),
    zone=None,
    satellites=None,
):
    """A small picture whose metadata tells of a large one."""
    exif = Image.Exif()
    exif[ExifTags.Base.Make], exif[ExifTags.Base.Model] = model
    details = exif.get_ifd(ExifTags.IFD.Exif)
    details[ExifTags.Base.DateTimeOriginal] = time
    if zone is not None:
        details[ExifTags.Base.OffsetTimeOriginal] = zone
    details[ExifTags.Base.ExposureTime] = IFDRational(round(exposure_s * 1_000_000), 1_000_000)
    details[ExifTags.Base.FocalLength] = IFDRational(round(focal_mm * 1000), 1000)
    if film_mm:
        details[ExifTags.Base.FocalLengthIn35mmFilm] = film_mm
    details[ExifTags.Base.ExifImageWidth], details[ExifTags.Base.ExifImageHeight] = pixels
    gps = exif.get_ifd(ExifTags.IFD.GPSInfo)
    if position is not None:
        lat, lon = position
        gps[1], gps[2] = "S" if lat < 0 else "N", _sexagesimal(lat)
        gps[3], gps[4] = "W" if lon < 0 else "E", _sexagesimal(lon)
    if satellites is not None:
        day, clock = satellites
        gps[29], gps[7] = day, tuple(IFDRational(part) for part in clock)
    if alt_m is not None:
        gps[5], gps[6] = bytes([below]), IFDRational(round(abs(alt_m) * 1000), 1000)
    size = (pixels[0] // 40, pixels[1] // 40)
    Image.new("L", size).save(path, exif=exif, **({"xmp": xmp.encode()} if xmp else {}))
