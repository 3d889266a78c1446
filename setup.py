# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Installs the package for colcon (`ros2 run`, `ros2 launch`) and for pip.

What describes the package stands in `pyproject.toml`. Here is what colcon asks setup() for, and
what is computed: the version, the page of the package index, and which programs there are.
"""

import re
import sys
from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

# Where this project lives. It has no public address yet: write it here and in package.xml, and
# nowhere else, see docs/releasing.md. Names that end in .example never exist.
ADDRESS = 'https://sar-imaging.example'
# colcon builds from a folder of links to this file, pyproject.toml and README.md not among them
HERE = Path(__file__).resolve().parent
VERSION = re.search(r"^__version__ = '(.+)'", (HERE / 'sar_imaging/__init__.py').read_text(),
                    re.MULTILINE)[1]
# A page of the package index knows no files beside it: links lead to those of this version.
FILES, PICTURES = f'{ADDRESS}/blob/{VERSION}/', f'{ADDRESS}/raw/{VERSION}/'

# Where `ros2 run` looks for executables; pip ignores it and uses its own bin folder.
EXECUTABLES = '$base/lib/sar_imaging'

# pip builds a wheel, whose programs are on everybody's path: one, `sar-imaging`. Programs for
# `ros2 run` have the short names below and stand in a folder of the package.
FOR_PIP = {'bdist_wheel', 'dist_info', 'editable_wheel'} & set(sys.argv)
ONE_PROGRAM = {'console_scripts': ['sar-imaging = sar_imaging.tools.command:main']}


def read_me():
    """README.md, whose relative links are addresses."""
    def absolute(link):
        if '://' in link['target'] or link['target'].startswith('#'):
            return link[0]
        return f"{link['text']}({PICTURES if link['picture'] else FILES}{link['target']})"

    text = (HERE / 'README.md').read_text(encoding='utf-8')
    return re.sub(r'(?P<text>(?P<picture>!?)\[[^]]*\])\((?P<target>[^)]+)\)', absolute, text)


arguments = dict(
    name='sar_imaging',
    version=VERSION,
    python_requires='>=3.10',  # colcon cannot read what setuptools makes of that in pyproject.toml
    long_description=read_me(),
    long_description_content_type='text/markdown',
    license='Apache-2.0',  # old and new setuptools want it differently in pyproject.toml
    url=ADDRESS,
    project_urls={'Documentation': f'{FILES}docs/index.md', 'Source': ADDRESS,
                  'Issues': f'{ADDRESS}/issues', 'Changelog': f'{FILES}CHANGELOG.rst'},
    packages=find_packages(include=['sar_imaging', 'sar_imaging.*',
                                    'msg_conversions', 'msg_conversions.*']),
    include_package_data=False,  # what is listed here, not what lies beside the modules
    # Twice on purpose: inside the package for importlib.resources, in share for ROS tools.
    package_data={'msg_conversions': ['py.typed'],
                  'sar_imaging': ['config/*.*', 'config/recordings/*', 'launch/*', 'resource/*',
                                  'planning/*.json', 'py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['sar_imaging/resource/sar_imaging']),
        ('share/sar_imaging', ['package.xml']),
        ('share/sar_imaging/launch', sorted(glob('sar_imaging/launch/*.launch.py'))),
        ('share/sar_imaging/config', sorted(glob('sar_imaging/config/*.*ml'))),
        ('share/sar_imaging/config/recordings',
         sorted(glob('sar_imaging/config/recordings/*.yaml'))),
        ('share/sar_imaging/resource', sorted(glob('sar_imaging/resource/*.*'))),
    ],
    entry_points={
        'console_scripts': [
            'radar_driver = sar_imaging.nodes.radar_driver:main',
            'pulse_buffer = sar_imaging.nodes.pulse_buffer:main',
            'range_compression = sar_imaging.nodes.range_compression:main',
            'backprojection = sar_imaging.nodes.backprojection:main',
            'afbp_fusion = sar_imaging.nodes.afbp_fusion:main',
            'sar_pipeline = sar_imaging.nodes.sar_pipeline:main',
            'moving_targets = sar_imaging.nodes.moving_targets:main',
            'localization = sar_imaging.nodes.localization:main',
            'wait_until_active = sar_imaging.tools.wait_until_active:main',
            'simulate = sar_imaging.tools.simulate:main',
            'simulate_archive = sar_imaging.tools.simulate_archive:main',
            'compile_kernels = sar_imaging.tools.compile_kernels:main',
            'environment = sar_imaging.tools.environment:main',
            'completion = sar_imaging.tools.completion:main',
            'measure_costs = sar_imaging.tools.measure_costs:main',
            'check_config = sar_imaging.tools.check_config:main',
            'evaluate = sar_imaging.tools.evaluate:main',
            'layouts = sar_imaging.tools.layouts:main',
            'archive = sar_imaging.tools.archive.archive:main',
            'image = sar_imaging.tools.products.image:main',
            'change = sar_imaging.tools.products.change:main',
            'reference_map = sar_imaging.tools.products.reference_map:main',
            'locate = sar_imaging.tools.products.locate:main',
            'radar_constant = sar_imaging.tools.products.radar_constant:main',
            'doctor = sar_imaging.tools.products.doctor:main',
            'convert = sar_imaging.tools.exchange.convert:main',
            'info = sar_imaging.tools.exchange.info:main',
            'calibrate = sar_imaging.tools.calibrate:main',
            'load = sar_imaging.tools.load:main',
        ],
    },
    options={'develop': {'script_dir': EXECUTABLES}, 'install': {'install_scripts': EXECUTABLES}},
    zip_safe=False,
)
if FOR_PIP:
    arguments['entry_points'] = ONE_PROGRAM

setup(**arguments)
