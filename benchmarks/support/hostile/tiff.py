# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Ways to damage GeoTIFF."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator

from .any_file import Damage, puts
from .yaml_json import values_of


def tiff_file(content: bytes) -> Iterator[Damage]:
    (start,) = struct.unpack('<I', content[4:8])
    (count,) = struct.unpack('<H', content[start:start + 2])
    for i in range(count):
        at = start + 2 + 12 * i
        tag, kind, n, value = struct.unpack('<HHII', content[at:at + 12])
        for told, new in (('value 0', (tag, kind, n, 0)),
                          ('value of 4 GB', (tag, kind, n, 2**32 - 1)),
                          ('count of 4 GB', (tag, kind, 2**32 - 1, value)),
                          ('type 99', (tag, 99, n, value))):
            out = bytearray(content)
            out[at:at + 12] = struct.pack('<HHII', *new)
            yield f'tag {tag}: {told}', puts(bytes(out))
    out = bytearray(content)
    out[start + 2 + 12 * count:start + 6 + 12 * count] = struct.pack('<I', start)
    yield 'directory that follows itself', puts(bytes(out))

    def written(count=1, dtype='complex64', shape=(8, 8), tags=None, **options):
        def put(path):
            import rasterio

            path.unlink()
            with rasterio.open(path, 'w', driver='GTiff', count=count, dtype=dtype,
                               height=shape[0], width=shape[1], **options) as file:
                file.update_tags(**(tags or {}))
        return put

    yield 'no place', written()
    yield 'three bands', written(3, 'uint8')
    yield 'bomb', written(shape=(40_000, 40_000), compress='deflate', tiled=True, SPARSE_OK=True,
                          tags={'CONTENT': 'complex'})
    import rasterio

    with rasterio.MemoryFile(content) as memory, memory.open() as file:
        (tag, text), = ((k, v) for k, v in file.tags().items() if v.startswith('{'))
    for told, other in values_of(json.loads(text)):
        yield f'tag: {told}', written(shape=(64, 64), tags={tag: json.dumps(other)})

    def beside(name, text):
        def put(path):
            path.with_name(path.name + name).write_text(text)
        return put

    yield 'another file beside it', beside('.aux.xml', '<PAMDataset>' + '<x>' * 10_000)
    yield 'overviews beside it', beside('.ovr', 'II*\0rubbish')
    yield 'mask beside it', beside('.msk', 'II*\0rubbish')
    yield 'VRT', puts(b'<VRTDataset rasterXSize="9" rasterYSize="9"><VRTRasterBand dataType="Byte"'
                      b' band="1"><SimpleSource><SourceFilename>secret</SourceFilename>'
                      b'</SimpleSource></VRTRasterBand></VRTDataset>')
