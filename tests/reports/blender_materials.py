"""Materials of mbinterval as Blender's nodes: runs in Python with bpy, for `blender_render`.

Lights have the scale of mbinterval's: a white wall that faces a light of colour 1 has colour 1.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np


class Nodes:
    """The nodes of a material."""

    def __init__(self, name: str) -> None:
        self.material = bpy.data.materials.new(name)
        self.material.use_nodes = True
        self.material.cycles.emission_sampling = "NONE"
        self.tree = self.material.node_tree
        self.tree.nodes.clear()

    def add(self, kind: str, *inputs: Any, **fields: Any) -> Any:
        """Add a node; what feeds its first inputs is a socket, a value or None."""
        node = self.tree.nodes.new(kind)
        for name, value in fields.items():
            setattr(node, name, value)
        for socket, value in zip(node.inputs, inputs, strict=False):
            if isinstance(value, bpy.types.NodeSocket):
                self.tree.links.new(value, socket)
            elif value is not None:
                socket.default_value = value
        return node

    def product(self, first: Any, second: Any) -> Any:
        """Colours multiplied, without a limit."""
        return self.add("ShaderNodeVectorMath", first, second, operation="MULTIPLY").outputs[0]

    def number(self, operation: str, first: Any, second: Any) -> Any:
        return self.add("ShaderNodeMath", first, second, operation=operation).outputs[0]

    def mixed(self, part: Any, first: Any, second: Any) -> Any:
        """``second`` by ``part``, ``first`` by the rest."""
        return self.add("ShaderNodeMixShader", part, first, second).outputs[0]


def image(pixels: np.ndarray, name: str) -> Any:
    """An image of linear ``pixels`` ``(h, w, 4)``, straight alpha, first row on top."""
    height, width = pixels.shape[:2]
    made = bpy.data.images.new(name, width, height, alpha=True, float_buffer=True)
    made.colorspace_settings.name = "Non-Color"
    made.alpha_mode = "CHANNEL_PACKED"
    made.pixels.foreach_set(np.ascontiguousarray(pixels[::-1], np.float32).ravel())
    made.update()
    made.pack()
    return made


def make_material(given: dict[str, Any], images: list[Any], ambient: list[float]) -> Any:
    """Nodes that shade as mbinterval does."""
    nodes = Nodes(given["name"] or "material")
    color, alpha = color_and_alpha(nodes, given, images)
    surface = shaded(nodes, given, color, ambient)
    clear = nodes.add("ShaderNodeBsdfTransparent").outputs[0]
    if given["alpha"] == "mask":
        alpha = nodes.number("GREATER_THAN", alpha, given["alpha_cutoff"])
    if given["alpha"] != "opaque":
        surface = nodes.mixed(alpha, clear, surface)
    if not given["double_sided"]:
        back = nodes.add("ShaderNodeNewGeometry").outputs["Backfacing"]
        surface = nodes.mixed(back, surface, clear)
    nodes.add("ShaderNodeOutputMaterial", surface)
    return nodes.material


def color_and_alpha(nodes: Nodes, given: dict[str, Any], images: list[Any]) -> tuple[Any, Any]:
    """Base colour times the mesh's colours times the texture; the same of alpha."""
    color = nodes.product([*given["base_color"]], [1.0, 1.0, 1.0])
    alpha: Any = given["opacity"]
    if given["colored"]:
        attribute = nodes.add("ShaderNodeAttribute", attribute_name="color")
        color = nodes.product(attribute.outputs["Vector"], color)
        alpha = nodes.number("MULTIPLY", attribute.outputs["Alpha"], alpha)
    if given["texture"] is not None:
        uv = nodes.add("ShaderNodeUVMap", uv_map="uv").outputs[0]
        kept = {"image": images[given["texture"]], "interpolation": "Linear"}
        texture = nodes.add("ShaderNodeTexImage", uv, extension="REPEAT", **kept)
        color = nodes.product(texture.outputs["Color"], color)
        alpha = nodes.number("MULTIPLY", texture.outputs["Alpha"], alpha)
    return color, alpha


def shaded(nodes: Nodes, given: dict[str, Any], color: Any, ambient: list[float]) -> Any:
    """Unlit, or Lambert's or GGX's with ambient light that reaches everything; a mirror's share."""
    if given["unlit"]:
        surface = nodes.add("ShaderNodeEmission", color).outputs[0]
    else:
        glow = nodes.add("ShaderNodeEmission", nodes.product(color, ambient)).outputs[0]
        if given["metal"]:
            kind = {"distribution": "GGX"}
            lit = nodes.add("ShaderNodeBsdfAnisotropic", color, given["roughness"], **kind)
        else:
            lit = nodes.add("ShaderNodeBsdfDiffuse", color)
        surface = nodes.add("ShaderNodeAddShader", lit.outputs[0], glow).outputs[0]
    if given["reflectivity"]:
        white = [1.0, 1.0, 1.0, 1.0]
        shine = nodes.add("ShaderNodeBsdfAnisotropic", white, 0.0).outputs[0]
        surface = nodes.mixed(given["reflectivity"], surface, shine)
    return surface
