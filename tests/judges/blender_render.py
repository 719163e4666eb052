"""Run with the path of a job (JSON, see ``scene.py``): Cycles renders its views to ``OUT/0.png``, ``OUT/1.png``, ...

Nothing is set but what the job says: Blender's own importer, the file's materials as they come in, the Standard view
transform. Pictures are 8 bit with straight alpha.
"""

import json
import math
import sys
from pathlib import Path

import bpy
from mathutils import Matrix, Vector


def from_gltf(point):
    """glTF's +Y up to Blender's +Z up, as its importer does: (x, y, z) becomes (x, -z, y)."""
    x, y, z = point
    return Vector((x, -z, y))


def import_asset(path):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=path)
    for armature in bpy.data.armatures:
        armature.pose_position = "REST"
    # The importer's helper shapes for bones are not part of the asset.
    for shape in [o for o in bpy.data.objects if o.name.startswith("Icosphere")]:
        if not shape.users_scene or shape.hide_render or not shape.material_slots:
            bpy.data.objects.remove(shape)


def set_light(job):
    """The environment, turned as the renderer turns it.

    Blender shows a file's middle column along +X, its own and glTF's; the renderer along glTF's +Z. A turn by a about
    glTF's +Y is one by a about Blender's +Z, and the Mapping node turns the direction that is looked up, so it gets the
    opposite: with the quarter turn between the two, 90 degrees - a.
    """
    world = bpy.data.worlds.new("light")
    world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    nodes.clear()
    place, turn = nodes.new("ShaderNodeTexCoord"), nodes.new("ShaderNodeMapping")
    image, back = nodes.new("ShaderNodeTexEnvironment"), nodes.new("ShaderNodeBackground")
    output = nodes.new("ShaderNodeOutputWorld")
    turn.inputs["Rotation"].default_value = (0, 0, math.radians(90 - job["rotation"]))
    image.image = bpy.data.images.load(job["light"])
    back.inputs["Strength"].default_value = job["factor"]
    links.new(place.outputs["Generated"], turn.inputs["Vector"])
    links.new(turn.outputs["Vector"], image.inputs["Vector"])
    links.new(image.outputs["Color"], back.inputs["Color"])
    links.new(back.outputs[0], output.inputs["Surface"])
    world.cycles.sampling_method = "MANUAL"
    world.cycles.sample_map_resolution = 1024
    bpy.context.scene.world = world


def set_camera(job, eye):
    scene = bpy.context.scene
    if scene.camera is None:
        scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
        scene.collection.objects.link(scene.camera)
    camera = scene.camera
    backward = (from_gltf(eye) - from_gltf(job["target"])).normalized()
    right = Vector((0, 0, 1)).cross(backward).normalized()
    frame = Matrix((right, backward.cross(right), backward)).transposed().to_4x4()
    camera.matrix_world = Matrix.Translation(from_gltf(eye)) @ frame
    camera.data.sensor_fit = "VERTICAL"
    camera.data.angle = math.radians(job["fov"])
    camera.data.clip_start, camera.data.clip_end = job["near"], job["far"]


def set_renderer(job):
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples, scene.cycles.use_adaptive_sampling = job["samples"], False
    scene.cycles.use_denoising, scene.cycles.seed = False, 0
    scene.cycles.sample_clamp_indirect = scene.cycles.sample_clamp_direct = 0.0
    scene.cycles.blur_glossy = 0.0
    scene.cycles.pixel_filter_type = "BOX"
    scene.render.threads_mode, scene.render.threads = "FIXED", job["threads"]
    scene.render.film_transparent = not job["backdrop"]
    scene.view_settings.view_transform, scene.view_settings.look = "Standard", "None"
    scene.view_settings.exposure, scene.view_settings.gamma = 0.0, 1.0
    scene.render.resolution_x = scene.render.resolution_y = job["size"]
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode, scene.render.image_settings.color_depth = "RGBA", "8"
    scene.render.dither_intensity = 0.0
    if job["unoccluded"]:
        # Seen by the camera alone: no ray that carries light meets the asset, so it neither shades nor lights itself.
        for thing in bpy.data.objects:
            thing.visible_diffuse = thing.visible_glossy = thing.visible_transmission = thing.visible_shadow = False


def main(path):
    job = json.loads(Path(path).read_text())
    import_asset(job["glb"])
    set_light(job)
    set_renderer(job)
    for i, eye in enumerate(job["eyes"]):
        set_camera(job, eye)
        bpy.context.scene.render.filepath = str(Path(job["out"]) / f"{i}.png")
        bpy.ops.render.render(write_still=True)


main(sys.argv[1])
