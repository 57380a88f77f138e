#!/usr/bin/python3
from catkin_pkg.python_setup import generate_distutils_setup
from setuptools import setup

setup(**generate_distutils_setup(packages=["node_parameters"], package_dir={"": "python"}))
