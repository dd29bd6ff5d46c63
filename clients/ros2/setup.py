from setuptools import setup

NAME = "foveate_ros"

setup(
    name=NAME,
    version="0.1.0",
    description="Follows one target through camera images, and reports how sure it is",
    license="MIT OR Apache-2.0",
    py_modules=["foveate_messages", "foveate_node"],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/foveate.launch.py"]),
    ],
    install_requires=["foveate", "numpy"],
    entry_points={"console_scripts": ["foveate_node = foveate_node:main"]},
)
