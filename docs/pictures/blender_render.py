"""Open a GLB in Blender, say what came in, and render it with Cycles under an HDR light (needs the `judges` extra).

    python docs/pictures/blender_render.py outputs/spot.glb spot.png

The environment lights the scene but is hidden from the camera behind a plain grey. View transform: Standard.
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path

import bpy
from mathutils import Vector

LIGHT = Path(__file__).parents[2] / "assets" / "envmaps" / "mud_road_puresky_512.hdr"


def inventory() -> dict[str, dict[str, str]]:
    """Per material used by a mesh: which image feeds which input of its Principled BSDF, with its colour space."""
    found: dict[str, dict[str, str]] = {}
    materials = {
        slot.material for o in bpy.data.objects if o.type == "MESH" for slot in o.material_slots if slot.material
    }
    for material in sorted(materials, key=lambda m: m.name):
        inputs = {}
        shader = next((n for n in material.node_tree.nodes if n.type == "BSDF_PRINCIPLED"), None)
        for name in ("Base Color", "Roughness", "Metallic", "Normal"):
            image = _image_behind(shader.inputs[name]) if shader else None
            inputs[name] = f"{image.size[0]}x{image.size[1]} {image.colorspace_settings.name}" if image else "none"
        found[material.name] = inputs
    return found


def _image_behind(socket: bpy.types.NodeSocket, depth: int = 6) -> bpy.types.Image | None:
    for link in socket.links if depth else ():
        if link.from_node.type == "TEX_IMAGE":
            return link.from_node.image
        for upstream in link.from_node.inputs:
            if (image := _image_behind(upstream, depth - 1)) is not None:
                return image
    return None


def render(out: Path, light: Path, size: int, samples: int, azimuth: float, elevation: float, exposure: float) -> None:
    scene = bpy.context.scene
    corners = [
        o.matrix_world @ Vector(c)
        for o in bpy.data.objects
        if o.type == "MESH" and not o.hide_render
        for c in o.bound_box
    ]
    low = Vector(min(c[i] for c in corners) for i in range(3))
    high = Vector(max(c[i] for c in corners) for i in range(3))
    center, half = (low + high) / 2, max(high - low) / 2

    a, e = math.radians(azimuth), math.radians(elevation)
    # glTF's front +Z comes in as Blender's -Y.
    toward = Vector((math.cos(e) * math.sin(a), -math.cos(e) * math.cos(a), math.sin(e)))
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.location = center + 3.25 * half * toward
    camera.rotation_euler = (-toward).to_track_quat("-Z", "Y").to_euler()
    camera.data.angle = math.radians(45)
    camera.data.clip_start, camera.data.clip_end = half / 100, half * 100
    scene.collection.objects.link(camera)
    scene.camera = camera

    world = bpy.data.worlds.new("light")
    world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    nodes.clear()
    image, back, path = (
        nodes.new("ShaderNodeTexEnvironment"),
        nodes.new("ShaderNodeBackground"),
        nodes.new("ShaderNodeLightPath"),
    )
    grey, mix, output = (
        nodes.new("ShaderNodeBackground"),
        nodes.new("ShaderNodeMixShader"),
        nodes.new("ShaderNodeOutputWorld"),
    )
    image.image = bpy.data.images.load(str(light.resolve()))
    back.inputs["Strength"].default_value = exposure
    grey.inputs["Color"].default_value = (0.62, 0.62, 0.62, 1)
    links.new(image.outputs["Color"], back.inputs["Color"])
    links.new(path.outputs["Is Camera Ray"], mix.inputs[0])
    links.new(back.outputs[0], mix.inputs[1])
    links.new(grey.outputs[0], mix.inputs[2])
    links.new(mix.outputs[0], output.inputs["Surface"])
    scene.world = world

    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.seed = samples, True, 0
    scene.view_settings.view_transform = "Standard"
    scene.render.resolution_x = scene.render.resolution_y = size
    scene.render.filepath = str(out.resolve())
    scene.render.image_settings.file_format = "PNG"
    bpy.ops.render.render(write_still=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("glb", type=Path)
    parser.add_argument("png", type=Path)
    parser.add_argument("--light", type=Path, default=LIGHT)
    parser.add_argument("--size", type=int, default=384)
    parser.add_argument("--samples", type=int, default=48)
    parser.add_argument("--azimuth", type=float, default=35.0)
    parser.add_argument("--elevation", type=float, default=15.0)
    parser.add_argument("--exposure", type=float, default=1.9)
    options = parser.parse_args()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(options.glb.resolve()))
    # The importer's helper shapes for bones are not part of the asset.
    for shape in [o for o in bpy.data.objects if o.name.startswith("Icosphere") and not o.users_scene]:
        bpy.data.objects.remove(shape)
    print(json.dumps(inventory()))
    render(
        options.png, options.light, options.size, options.samples, options.azimuth, options.elevation, options.exposure
    )


if __name__ == "__main__":
    main()
