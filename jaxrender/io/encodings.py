"""What an image file states about its values: whether they are linear, and in which colours.

Only what a file truly states counts: an ICC profile, the gamma of a PNG, the colour space of Exif.
A library's guess, that every PNG and JPEG is sRGB, is none.
"""

import OpenImageIO as oiio

from jaxrender.imaging import SRGB, Linear, Response

LINEAR, STANDARD, DISPLAY_P3, ADOBE, GAMMA = "linear", "sRGB", "Display P3", "Adobe RGB", "gamma"
# What the description of a profile has in it, in the order in which it is looked for.
_PROFILES = (
    ("linear", LINEAR),
    ("display p3", DISPLAY_P3),
    ("adobe rgb", ADOBE),
    ("srgb", STANDARD),
)
_EXIF_STANDARD = 1


def stated_encoding(spec: "oiio.ImageSpec") -> str | None:
    """Read the encoding that a picture's metadata state; None where they state none."""
    profile = spec.get_string_attribute("ICCProfile:profile_description").lower()
    for word, encoding in _PROFILES:
        if word in profile:
            return encoding
    if profile:
        return None
    # A PNG whose gamma is stated; sRGB is what the library says of all others.
    space = spec.get_string_attribute("oiio:ColorSpace")
    if space.startswith("lin_") and spec.format.basetype in (oiio.UINT8, oiio.UINT16):
        return LINEAR
    if spec.get_float_attribute("oiio:Gamma", 0) > 1:
        return GAMMA
    if spec.get_int_attribute("Exif:ColorSpace", 0) == _EXIF_STANDARD:
        return STANDARD
    return None


def contradiction(encoding: str | None, response: Response) -> str | None:
    """Say how what a file states contradicts the response of the user; None if it does not.

    A measured curve contradicts nothing: it was found for the very camera.
    """
    if encoding is None:
        return None
    if isinstance(response, Linear) and encoding != LINEAR:
        return f"its metadata say {encoding}, but the stated response is linear"
    if isinstance(response, SRGB) and encoding == LINEAR:
        return "its metadata say linear, but the stated response is srgb"
    if isinstance(response, SRGB) and encoding in (DISPLAY_P3, ADOBE):
        return (
            f"its metadata say {encoding}, whose red, green and blue are not those of sRGB: "
            "convert the picture, or saturated colours are off"
        )
    return None
