"""Run with a file's path: opens it in Blender and prints, as the last line, JSON of its objects and materials."""

import json
import sys

import bpy


def images_of(socket):
    """Names of the image textures that feed a socket, through whatever nodes lie between."""
    found, todo = [], [socket]
    while todo:
        for link in todo.pop().links:
            if link.from_node.type == "TEX_IMAGE":
                found.append(link.from_node.image.name)
            todo += [s for s in link.from_node.inputs if s.is_linked]
    return sorted(set(found))


def main(path):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if path.endswith(".obj"):
        bpy.ops.wm.obj_import(filepath=path)
    else:
        bpy.ops.import_scene.gltf(filepath=path)
    materials = {}
    for material in bpy.data.materials:
        if material.users and material.use_nodes:
            shader = next((n for n in material.node_tree.nodes if n.type == "BSDF_PRINCIPLED"), None)
            if shader is not None:
                names = ("Base Color", "Roughness", "Metallic", "Normal", "Alpha")
                materials[material.name] = {name: images_of(shader.inputs[name]) for name in names}
    images = {
        image.name: {
            "colorspace": image.colorspace_settings.name,
            "size": list(image.size),
            "first_pixels": [round(v * 255) for v in image.pixels[: 4 * image.size[0]]],
        }
        for image in bpy.data.images
        if image.size[0]
    }
    objects = {
        o.name: {
            "vertices": len(o.data.vertices),
            "faces": len(o.data.polygons),
            "materials": [m.name for m in o.data.materials],
            "groups": len(o.vertex_groups),
        }
        for o in bpy.data.objects
        if o.type == "MESH"
    }
    sys.stdout.write(
        "\n"
        + json.dumps(
            {
                "materials": materials,
                "images": images,
                "objects": objects,
                "actions": len(bpy.data.actions),
                "armatures": len(bpy.data.armatures),
            }
        )
        + "\n"
    )


main(sys.argv[1])
