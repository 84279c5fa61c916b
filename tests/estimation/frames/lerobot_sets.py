"""LeRobot data sets written for tests, as other programs write them."""

import json
from fractions import Fraction

import av
import numpy as np
import pyarrow
from pyarrow import parquet

GEL = "observation.images.gel"
RATE = 25


def write_video(path, images):
    video = path / "videos" / GEL / "chunk-000" / "file-000.mp4"
    video.parent.mkdir(parents=True)
    with av.open(str(video), "w") as container:
        stream = container.add_stream("libx264", rate=RATE, options={"qp": "4", "g": "100"})
        stream.height, stream.width = images[0].shape[:2]
        stream.pix_fmt, stream.time_base = "yuv420p", Fraction(1, RATE)
        for image in images:
            frame = av.VideoFrame.from_ndarray(image, format="gray").reformat(format="yuv420p")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def write_set(path, features, lengths, version="v3.0", video="file-{file_index:03d}.mp4"):
    folder = path / "meta" / "episodes" / "chunk-000"
    folder.mkdir(parents=True)
    template = "videos/{video_key}/chunk-{chunk_index:03d}/" + video
    info = {"codebase_version": version, "video_path": template, "features": features}
    (path / "meta" / "info.json").write_text(json.dumps(info))
    ends = np.cumsum(lengths) / RATE
    count = len(lengths)
    columns = {"episode_index": range(count), "length": lengths}
    for name in features:
        columns |= {f"videos/{name}/{one}_index": [0] * count for one in ("chunk", "file")}
        columns[f"videos/{name}/from_timestamp"] = ends - np.array(lengths) / RATE
        columns[f"videos/{name}/to_timestamp"] = ends
    table = pyarrow.table({name: pyarrow.array(list(one)) for name, one in columns.items()})
    parquet.write_table(table, folder / "file-000.parquet")
