# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Build Python packages of ROS messages from definitions, without CMake and without a workspace.

The rosidl generators come with the ROS wheels; gcc and g++ compile what they write. All of a
package stands in one extension module, and a small dispatcher takes the place of the library that
would look for those of each middleware.
"""

from __future__ import annotations

import importlib.metadata
import shutil
import subprocess
import sys
import sysconfig
import types
from pathlib import Path

import numpy as np

PREFIX = Path(sys.prefix)
_USED = ('std_msgs', 'builtin_interfaces')  # by the definitions
_KINDS = ('rosidl_generator_c', 'rosidl_generator_py', 'rosidl_typesupport_fastrtps_c',
          'rosidl_typesupport_introspection_c')
_OTHERS = ('rosidl_runtime_c', 'rosidl_typesupport_fastrtps_c', 'rosidl_typesupport_fastrtps_cpp',
           'rosidl_typesupport_introspection_c', 'rosidl_typesupport_c', 'rcutils', 'rmw',
           'fastcdr')
_DISPATCH = """
#include <string.h>
#include "rosidl_runtime_c/message_type_support_struct.h"
const rosidl_message_type_support_t * rosidl_typesupport_fastrtps_c__get@(void);
const rosidl_message_type_support_t * rosidl_typesupport_introspection_c__get@(void);
static const rosidl_message_type_support_t * find(
  const rosidl_message_type_support_t * handle, const char * identifier)
{
  if (strcmp(identifier, "rosidl_typesupport_fastrtps_c") == 0) {
    return rosidl_typesupport_fastrtps_c__get@();
  }
  if (strcmp(identifier, "rosidl_typesupport_introspection_c") == 0) {
    return rosidl_typesupport_introspection_c__get@();
  }
  return strcmp(identifier, handle->typesupport_identifier) ? NULL : handle;
}
const rosidl_message_type_support_t * rosidl_typesupport_c__get@(void)
{
  static rosidl_message_type_support_t handle;
  handle = *rosidl_typesupport_fastrtps_c__get@();
  handle.typesupport_identifier = "rosidl_typesupport_c";
  handle.func = find;
  return &handle;
}
"""


def why_not() -> str:
    """What a package cannot be built for; empty where it can."""
    if not (shutil.which('gcc') and shutil.which('g++')):
        return 'gcc and g++ are not installed'
    if not (PREFIX / 'include' / 'rosidl_runtime_c').is_dir():
        return 'the rosidl generators of the ROS wheels are not in this environment'
    if not (Path(sysconfig.get_paths()['include']) / 'Python.h').is_file():
        return 'the headers of Python are not installed'
    return ''


def build(folder: Path, package: str, definitions: dict[str, str]) -> None:
    """Build a package below a folder, which then belongs on the path of Python.

    Parameters
    ----------
    folder : Path
        For the package, and for what is needed to build it.
    package : str
        Name.
    definitions : dict of str to str
        Text of each message by its name.
    """
    out = _generate(folder, package, definitions)
    include = folder / 'include' / package
    for kind in ('c', 'fastrtps_c', 'introspection_c'):
        for header in (out / kind).rglob('*.h'):
            place = include / header.relative_to(out / kind)
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(header, place)
    place = folder / package
    (place / 'msg').mkdir(parents=True)
    (place / '__init__.py').write_text('')
    for file in (out / 'py' / 'msg').glob('*.py'):
        shutil.copy(file, place / 'msg')
    sources = [*(out / 'c' / 'msg' / 'detail').glob('*.c'), *(out / 'py' / 'msg').glob('*_s.c'),
               out / 'py' / f'_{package}_s.ep.rosidl_typesupport_fastrtps_c.c',
               *(out / 'fastrtps_c').rglob('*.cpp'), *(out / 'introspection_c').rglob('*.c'),
               *(_dispatcher(out, package, name) for name in definitions)]
    objects = [_compiled(folder, package, file, number) for number, file in enumerate(sources)]
    subprocess.run(
        ['g++', '-shared', '-o', place / f'{package}_s__rosidl_typesupport_c.so', *objects,
         f'-L{PREFIX / "lib"}', f'-Wl,-rpath,{PREFIX / "lib"}',
         *(f'-l{name}__{kind}' for name in _USED for kind in _KINDS),
         *(f'-l{name}' for name in _OTHERS)], check=True)


def _generate(folder: Path, package: str, definitions: dict[str, str]) -> Path:
    source, out = folder / 'source' / package, folder / 'generated' / package
    (source / 'msg').mkdir(parents=True)
    for name, text in definitions.items():
        (source / 'msg' / f'{name}.msg').write_text(text)
    _generator()(package_name=package, output_path=out, types=['c', 'py'],
                 interface_files=[f'{source}:msg/{name}.msg' for name in definitions],
                 include_paths=[str(PREFIX / 'share')],
                 typesupports=['fastrtps_c', 'introspection_c'])
    return out


def _generator():
    """The generators' own function, past what the wheels lack."""
    # It only looks for package.xml, which nobody needs here.
    for name in ('catkin_pkg', 'catkin_pkg.package'):
        sys.modules.setdefault(name, types.ModuleType(name))
    package = sys.modules['catkin_pkg.package']
    package.parse_package = package.package_exists_at = None
    import rosidl_cli.entry_points as entry_points

    class Once:
        """Entry points, of which the wheels have each twice."""

        @staticmethod
        def select(group):
            found = importlib.metadata.entry_points(group=group)
            return list({entry.name: entry for entry in found}.values())

    entry_points.importlib_metadata = types.SimpleNamespace(entry_points=Once)
    from rosidl_cli.command.generate.api import generate

    return generate


def _dispatcher(out: Path, package: str, name: str) -> Path:
    file = out / f'{name}_dispatch.c'
    file.write_text(_DISPATCH.replace(
        '@', f'_message_type_support_handle__{package}__msg__{name}'))
    return file


def _compiled(folder: Path, package: str, file: Path, number: int) -> Path:
    target = folder / 'objects' / package / f'{number}.o'
    target.parent.mkdir(parents=True, exist_ok=True)
    includes = [folder / 'include', sysconfig.get_paths()['include'], np.get_include(),
                PREFIX / 'include', *(p for p in (PREFIX / 'include').iterdir() if p.is_dir())]
    # rclpy asks for the module by the name of the dispatcher.
    name = f'PyInit_{package}_s__rosidl_typesupport'
    subprocess.run(['g++' if file.suffix == '.cpp' else 'gcc', '-O0', '-fPIC', '-w', '-c', file,
                    '-o', target, f'-D{name}_fastrtps_c={name}_c', *(f'-I{p}' for p in includes)],
                   check=True)
    return target


def main(folder: str) -> None:
    """Build the packages of all drivers; in a process of its own, since it changes modules."""
    from .driver_messages import DEFINITIONS

    packages: dict[str, dict[str, str]] = {}
    for name, text in DEFINITIONS.items():
        packages.setdefault(name.partition('/')[0], {})[name.rpartition('/')[2]] = text
    for package, definitions in packages.items():
        build(Path(folder), package, definitions)


if __name__ == '__main__':
    main(sys.argv[1])
