from setuptools import setup

setup(
    name="my_clutch",
    version="1.0.0",
    description="A slip controller that is tested with tcc_sim",
    packages=["my_clutch"],
    install_requires=["tcc_sim"],
    extras_require={"test": ["pytest"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/my_clutch"]),
        ("share/my_clutch", ["package.xml"]),
    ],
    entry_points={"console_scripts": [
        "controller = my_clutch.node:main",
        "timed_controller = my_clutch.timed:main",
    ]},
)
