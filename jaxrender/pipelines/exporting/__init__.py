"""``jaxrender export``: a result in the files of other programs.

``contents``
    the material, shape, light and cameras of a finished run
``differences``
    how far an exported material is from the recovered one
``nearest_gltf``
    the material of glTF that is nearest to any other
``prepared``
    an export that may begin, and one that is done
``textures``
    what formats lose of a texture, and who writes it
``formats``
    every format by its name: what it needs, what it loses, who writes it
``readme``
    the README.txt that goes with the files
``exporting``
    the command: from a result folder to a folder of files
"""

from jaxrender.pipelines.exporting.exporting import Exported, export

__all__ = ["Exported", "export"]
