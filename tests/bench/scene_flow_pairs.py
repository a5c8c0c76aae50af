#!/usr/bin/python3
"""Makes sequence folders of two frames, with true motion, from stereo and scene-flow pairs that lie beside the project.

Usage: tests/bench/scene_flow_pairs.py DATA OUT
  DATA  folder with multiview/{art,books,dolls} (Middlebury 2005, views 1 and 5), sceneflow/carpetball and
        sceneflow/flyingthings; those that are absent are left out
  OUT   gets a sequence folder for each: colour and depth of both frames, gt/flow_key, gt/sceneflow_key; and
        camera_second.json where the second frame's camera is not the first's

Needs NumPy and Pillow (Debian: python3-numpy, python3-pil).

  art, books, dolls  The camera moves 160 mm to the right: depth f B / (d + dmin), motion (-B, 0, 0). View 5 is cropped
                     by dmin: camera_second.json has its principal point. A pixel is hidden where view 5 shows something
                     nearer.
  carpetball         Exact depth and motion at t0, in units taken for centimetres. Depth at t1 is t0's points, moved,
                     and joined with their neighbours on the same surface.
  flyingthings       Depth of both frames from disparity, baseline taken for a tenth of a metre. No true motion.
"""
import json
import pathlib
import sys

import numpy
from PIL import Image

SAME_SURFACE = 0.02  # share of depth


def write_pair(folder, camera, scale, colors, depths, truth=None):
    """`truth`: flow (H W 2), motion (H W 3), valid, hidden; bool arrays."""
    for name in ("rgb", "depth", "gt/flow_key", "gt/sceneflow_key"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    for i in range(2):
        Image.fromarray(colors[i]).save(folder / f"rgb/{i:06d}.png")
        units = numpy.clip(numpy.round(depths[i] * scale), 0, 65535).astype(numpy.uint16)
        Image.fromarray(units).save(folder / f"depth/{i:06d}.png")
    for name, kind in (("rgb", "rgb"), ("depth", "depth")):
        lines = ["# timestamp filename"] + [f"{i / 30:.9f} {kind}/{i:06d}.png" for i in range(2)]
        (folder / f"{name}.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / "camera.json").write_text(json.dumps({**camera, "depth_scale": scale}) + "\n", encoding="utf-8")
    if truth is None:
        return
    flow, motion, valid, hidden = truth
    numpy.savez_compressed(folder / "gt/sceneflow_key/000000_000001.npz", sf=motion.astype(numpy.float32), valid=valid,
                           flow=flow.astype(numpy.float32))
    Image.fromarray(numpy.where(hidden, 255, 0).astype(numpy.uint8)).save(
        folder / "gt/flow_key/occ_000000_000001.png")


def camera_of(image, focal, cx, cy):
    return {"width": image.shape[1], "height": image.shape[0], "fx": focal, "fy": focal, "cx": cx, "cy": cy}


def middlebury(source, folder):
    focal, baseline = 3740.0 / 3, 0.160
    dmin = float((source / "dmin.txt").read_text(encoding="utf-8").split()[0])
    colors = [numpy.array(Image.open(source / f"view{i}.png").convert("RGB")) for i in (1, 5)]
    disparities = [numpy.array(Image.open(source / f"disp{i}.png")).astype(float) for i in (1, 5)]
    height, width = disparities[0].shape
    depths = [numpy.where(d > 0, focal * baseline / ((d + dmin) / 3), 0.0) for d in disparities]
    valid = depths[0] > 0
    z = numpy.where(valid, depths[0], 1.0)
    flow = numpy.zeros(valid.shape + (2,))
    flow[..., 0] = -disparities[0] / 3
    motion = numpy.zeros(valid.shape + (3,))
    motion[..., 0] = numpy.where(valid, -baseline, 0)
    nearest = numpy.round(numpy.arange(width)[None, :] + flow[..., 0]).astype(int)
    there = numpy.take_along_axis(depths[1], numpy.clip(nearest, 0, width - 1), axis=1)
    hidden = valid & ((nearest < 0) | ((there > 0) & (there < z * (1 - SAME_SURFACE))))
    cameras = [camera_of(colors[0], focal, cx, (height - 1) / 2) for cx in ((width - 1) / 2, (width - 1) / 2 + dmin / 3)]
    write_pair(folder, cameras[0], 20000, colors, depths, (flow, motion, valid, hidden))
    (folder / "camera_second.json").write_text(json.dumps({**cameras[1], "depth_scale": 20000}) + "\n", encoding="utf-8")


def splat_mesh(columns, rows, z, surface_z, width, height):
    """Depth of moved points, joined with their right and lower neighbours on the same surface; nearest wins."""
    out = numpy.full((height, width), numpy.inf)
    steps = numpy.linspace(0, 1, 4, endpoint=False)
    for a in steps:
        for b in steps:
            def mix(f):
                right = numpy.roll(f, -1, 1)
                below = numpy.roll(f, -1, 0)
                both = numpy.roll(right, -1, 0)
                return (1 - a) * (1 - b) * f + a * (1 - b) * right + (1 - a) * b * below + a * b * both
            near = numpy.minimum.reduce([numpy.roll(numpy.roll(surface_z, -i, 0), -j, 1) for i in (0, 1) for j in (0, 1)])
            far = numpy.maximum.reduce([numpy.roll(numpy.roll(surface_z, -i, 0), -j, 1) for i in (0, 1) for j in (0, 1)])
            joined = (far - near) < SAME_SURFACE * near
            joined[-1], joined[:, -1] = False, False
            if a == 0 and b == 0:
                joined[:] = True
            x, y, depth = (numpy.round(mix(columns)).astype(int), numpy.round(mix(rows)).astype(int), mix(z))
            keep = joined & (x >= 0) & (y >= 0) & (x < width) & (y < height)
            numpy.minimum.at(out, (y[keep], x[keep]), depth[keep])
    out[~numpy.isfinite(out)] = 0
    return out


def carpetball(source, folder):
    focal, centre, metres = 389.711431, 225.0, 0.01
    read = lambda name: numpy.loadtxt(source / f"GroundTruth/{name}/{name}_0000.txt")
    z = read("Z") * metres
    motion = numpy.stack([read(name) * metres for name in "uvw"], axis=-1)
    colors = [numpy.array(Image.open(source / f"CarpetBall_t{t}_0.png").convert("RGB")) for t in (0, 1)]
    height, width = z.shape
    x, y = numpy.meshgrid(numpy.arange(width), numpy.arange(height))
    points = numpy.stack([(x - centre) / focal * z, (y - centre) / focal * z, z], axis=-1)
    moved = points + motion
    columns = focal * moved[..., 0] / moved[..., 2] + centre
    rows = focal * moved[..., 1] / moved[..., 2] + centre
    flow = numpy.stack([columns - x, rows - y], axis=-1)
    second = splat_mesh(columns, rows, moved[..., 2], z, width, height)
    inside = (columns > -0.5) & (rows > -0.5) & (columns < width - 0.5) & (rows < height - 0.5)
    there = second[numpy.clip(numpy.round(rows).astype(int), 0, height - 1),
                   numpy.clip(numpy.round(columns).astype(int), 0, width - 1)]
    hidden = ~inside | ((there > 0) & (there < moved[..., 2] * (1 - SAME_SURFACE)))
    valid = numpy.ones(z.shape, bool)
    write_pair(folder, camera_of(colors[0], focal, centre, centre), 8000, colors, [z, second],
               (flow, motion, valid, hidden))


def read_pfm(path):
    with open(path, "rb") as file:
        file.readline()
        width, height = map(int, file.readline().split())
        scale = float(file.readline())
        values = numpy.frombuffer(file.read(), "<f4" if scale < 0 else ">f4", width * height)
    return numpy.flipud(values.reshape(height, width)).astype(float)


def flyingthings(source, folder):
    focal, baseline = 1050.0, 0.1
    colors = [numpy.array(Image.open(source / f"image{i}.png").convert("RGB")) for i in (1, 2)]
    depths = [focal * baseline / numpy.maximum(numpy.abs(read_pfm(source / f"disp{i}.pfm")), 0.5) for i in (1, 2)]
    write_pair(folder, camera_of(colors[0], focal, 479.5, 269.5), 5000, colors, depths)


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    data, out = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
    jobs = [(f"multiview/{name}", middlebury) for name in ("art", "books", "dolls")]
    jobs += [("sceneflow/carpetball", carpetball), ("sceneflow/flyingthings", flyingthings)]
    for path, convert in jobs:
        source = data / path
        if source.is_dir():
            convert(source, out / source.name)
            print(out / source.name)
        else:
            print(f"({path} is not here)", file=sys.stderr)


main()
