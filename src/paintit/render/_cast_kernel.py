"""The Warp kernel of :mod:`paintit.render.visibility`; apart, because Warp reads its source and annotations."""
# pyright: reportInvalidTypeForm=false, reportAttributeAccessIssue=false

import warp as wp


@wp.kernel
def cast_kernel(
    mesh: wp.uint64,
    max_distance: float,
    origins: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    face: wp.array(dtype=wp.int32),
    place: wp.array(dtype=wp.vec3),
):
    """One ray: the face it meets first (-1: none) and the weights of that face's corners 0 and 1, and the distance."""
    i = wp.tid()
    query = wp.mesh_query_ray(mesh, origins[i], directions[i], max_distance)
    face[i] = -1
    if query.result:
        face[i] = query.face
        place[i] = wp.vec3(query.u, query.v, query.t)
    else:
        place[i] = wp.vec3(0.0, 0.0, 0.0)
