# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Installs the package for colcon (`ros2 run`, `ros2 launch`) and for pip."""

import sys
from glob import glob

from setuptools import find_packages, setup

# Where `ros2 run` looks for executables; pip ignores it and uses its own bin folder.
EXECUTABLES = '$base/lib/sar_imaging'

# pip builds a wheel, whose programs are on everybody's path: one, `sar-imaging`. Programs for
# `ros2 run` have the short names below and stand in a folder of the package.
FOR_PIP = {'bdist_wheel', 'dist_info', 'editable_wheel'} & set(sys.argv)
ONE_PROGRAM = {'console_scripts': ['sar-imaging = sar_imaging.tools.command:main']}

arguments = dict(
    name='sar_imaging',
    version='0.2.0',
    description='Multichannel synthetic aperture radar imaging for ROS 2',
    license='Apache-2.0',
    maintainer='SAR Imaging maintainers',
    maintainer_email='maintainers@users.noreply.h-seed-39d5f724.example',
    python_requires='>=3.10',
    packages=find_packages(include=['sar_imaging', 'sar_imaging.*',
                                    'msg_conversions', 'msg_conversions.*']),
    # Twice on purpose: inside the package for importlib.resources, in share for ROS tools.
    package_data={'sar_imaging': ['config/*.*', 'config/recordings/*', 'launch/*', 'resource/*',
                                  'planning/*.json']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['sar_imaging/resource/sar_imaging']),
        ('share/sar_imaging', ['package.xml']),
        ('share/sar_imaging/launch', sorted(glob('sar_imaging/launch/*.launch.py'))),
        ('share/sar_imaging/config', sorted(glob('sar_imaging/config/*.*ml'))),
        ('share/sar_imaging/config/recordings',
         sorted(glob('sar_imaging/config/recordings/*.yaml'))),
        ('share/sar_imaging/resource', sorted(glob('sar_imaging/resource/*.*'))),
    ],
    # rclpy and the messages stand in package.xml only: on a robot they come from the system.
    install_requires=[
        'numpy>=1.26,<3',
        'scipy>=1.11,<2',
        'numba>=0.58,<1',
        'matplotlib>=3.6,<4',
        'pyyaml>=6,<7',
        'rosbags>=0.11.7,<0.12',
        'tqdm>=4.64,<5',
    ],
    # Formats of files, see sar_imaging.formats; sarkit exists for Python 3.11 and later. Archives,
    # see sar_imaging.archive, need those too; so does zarr 3.
    extras_require={'formats': ['sarkit>=1.3,<2 ; python_version>="3.11"', 'rasterio>=1.3,<2',
                                'pyproj>=3.4,<4', 'pystac>=1.8,<2'],
                    'archive': ['sar_imaging[formats]',
                                'dask>=2024.1,<2027', 'distributed>=2024.1,<2027',
                                'bokeh>=3.1,<4', 'zarr>=3,<4 ; python_version>="3.11"',
                                'zarr>=2.18,<3 ; python_version<"3.11"',
                                'numcodecs>=0.11,<0.16 ; python_version<"3.11"'],
                    'hdf5': ['h5py>=3.8,<4'],  # MATLAB 7.3 and HDF5, see docs/loading.md
                    # the documentation site, `make docs`
                    'docs': ['sphinx>=8.1,<10', 'myst-parser>=4,<6', 'numpydoc>=1.8,<2',
                             'furo>=2025.7,<2027', 'sphinx-copybutton>=0.5.2,<0.6',
                             'sphinx-gallery>=0.18,<0.24', 'latex2mathml>=3.77,<4'],
                    # devices, see docs/gpu.md
                    # (numba-cuda 0.30 compiles nothing beside NumPy 2.5, which lacks row_stack)
                    'cuda': ['cupy-cuda13x[ctk]>=14,<15', 'numba-cuda[cu13]>=0.20,<1',
                             'numpy<2.5'],
                    'test': ['pytest>=7.4,<10', 'pytest-xdist>=3.7,<4', 'hypothesis>=6.80,<7']},
    entry_points={
        'console_scripts': [
            'radar_driver = sar_imaging.nodes.radar_driver:main',
            'pulse_buffer = sar_imaging.nodes.pulse_buffer:main',
            'range_compression = sar_imaging.nodes.range_compression:main',
            'backprojection = sar_imaging.nodes.backprojection:main',
            'afbp_fusion = sar_imaging.nodes.afbp_fusion:main',
            'sar_pipeline = sar_imaging.nodes.sar_pipeline:main',
            'moving_targets = sar_imaging.nodes.moving_targets:main',
            'wait_until_active = sar_imaging.tools.wait_until_active:main',
            'simulate = sar_imaging.tools.simulate:main',
            'simulate_archive = sar_imaging.tools.simulate_archive:main',
            'compile_kernels = sar_imaging.tools.compile_kernels:main',
            'environment = sar_imaging.tools.environment:main',
            'measure_costs = sar_imaging.tools.measure_costs:main',
            'check_config = sar_imaging.tools.check_config:main',
            'evaluate = sar_imaging.tools.evaluate:main',
            'layouts = sar_imaging.tools.layouts:main',
            'archive = sar_imaging.tools.archive.archive:main',
            'image = sar_imaging.tools.products.image:main',
            'change = sar_imaging.tools.products.change:main',
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
