"""The packages round an exported coupling: CMake installs and finds it, the sketch runs on Arduino's own core."""

import json
import re
import subprocess
import tempfile
import threading
from pathlib import Path

import numpy as np
import pytest
from exported import WARNINGS, Exported
from exported_cases import drawn
from hardware_bench import coupling, export_c, require, run, scratch

import avc_casadi
import avc_casadi.cli._export
from avc_casadi import InputError
from avc_casadi.coupling import Coupling
from avc_casadi.model.runtime import Runtime
from avc_hardware.codegen.packages import PACKAGES

ROOT = Path(__file__).parents[1]
CORE = Path("/usr/share/arduino/hardware/arduino/avr/cores")
LIBRARIES = ("arduino", "platformio", "cmake", "esp-idf", "zephyr")


def written(made: Coupling, *packages: str) -> Path:
    folder = Path(tempfile.mkdtemp(dir=scratch()))
    for place, text in export_c(made, packages=packages).items():
        (folder / place).parent.mkdir(parents=True, exist_ok=True)
        (folder / place).write_text(text, encoding="utf-8")
    return folder


def test_packages_stand_round_the_same_two_files() -> None:
    made = drawn(2)
    alone, together = export_c(made), export_c(made, packages=LIBRARIES)
    assert {f"src/{name}": text for name, text in alone.items()}.items() <= together.items()
    assert not any("@" in re.sub(r"@(param|author)", "", text) for text in together.values())
    assert avc_casadi.cli._export.PACKAGES == PACKAGES
    with pytest.raises(InputError, match="packages: holds 'conan'; allowed: arduino, platformio, cmake, esp-idf"):
        export_c(made, packages=["cmake", "conan"])


# Of the registries' published rules: Arduino's library specification 2.2 with arduino-lint, PlatformIO's manifest.
CATEGORIES = ("Display", "Communication", "Signal Input/Output", "Sensors", "Device Control", "Timing")
CATEGORIES += ("Data Storage", "Data Processing", "Other")
NEEDED = {"name", "version", "author", "maintainer", "sentence", "paragraph", "category", "url", "architectures"}
OPTIONAL = {"depends", "dot_a_linkage", "includes", "precompiled", "ldflags"}
RELEASE = r"\d+\.\d+\.\d+"


@pytest.mark.parametrize("name", ["avc_coupling", "soft"])
def test_a_package_has_what_the_registry_of_arduino_asks_for(name: str) -> None:
    files = export_c(drawn(2), packages=("arduino",), name=name)
    properties = dict(line.split("=", 1) for line in files["library.properties"].splitlines())
    assert NEEDED <= properties.keys() <= NEEDED | OPTIONAL
    assert all(properties.values())
    assert re.fullmatch(r"[a-zA-Z][\w.-]{,62}", properties["name"])
    assert "arduino" not in properties["name"].lower()
    assert re.fullmatch(RELEASE, properties["version"])
    assert properties["version"] == avc_casadi.__version__
    assert properties["category"] in CATEGORIES
    assert re.fullmatch(r"https://[\w.-]+/\S+", properties["url"])
    assert not properties["paragraph"].startswith(properties["sentence"])
    header = files[f"src/{properties['includes']}"]
    assert properties["includes"] == f"{properties['name']}.h"
    assert {"README.md", "LICENSE", "keywords.txt"} <= files.keys()
    for place in files:
        if place.startswith("examples/"):
            _, folder, sketch = place.split("/")
            assert sketch == f"{folder}.ino"
    words = [line.split("\t") for line in files["keywords.txt"].splitlines() if line and not line.startswith("#")]
    assert {kind for _, kind in words} <= {"KEYWORD1", "KEYWORD2", "LITERAL1"}
    assert all(re.search(rf"\b{word}\b", header) for word, _ in words)
    declared = set(re.findall(rf"\b{name}_\w+(?=\()", header)) | set(re.findall(rf"\b{name}_\w*t(?=;)", header))
    assert declared <= {word for word, _ in words}


@pytest.mark.parametrize("name", ["avc_coupling", "soft"])
def test_a_package_has_what_the_registry_of_platformio_asks_for(name: str) -> None:
    files = export_c(drawn(2), packages=("platformio",), name=name)
    manifest = json.loads(files["library.json"])
    assert re.fullmatch(r"[a-z][a-z0-9]*(-[a-z0-9]+)*", manifest["name"])
    assert len(manifest["name"]) <= 50
    assert re.fullmatch(RELEASE, manifest["version"])
    assert 0 < len(manifest["description"]) <= 255
    assert all(re.fullmatch(r"[a-z0-9][a-z0-9 +-]{1,49}", word) for word in manifest["keywords"])
    assert manifest["license"] == "MIT"
    assert manifest["repository"]["type"] == "git"
    assert all(url.startswith("https://") for url in (manifest["homepage"], manifest["repository"]["url"]))
    assert any(author["name"] and author.get("maintainer") for author in manifest["authors"])
    assert f"src/{manifest['headers']}" in files
    assert {"README.md", "LICENSE"} <= files.keys()
    for example in manifest["examples"]:
        assert all(f"{example['base']}/{file}" in files for file in example["files"])


def test_the_license_of_a_package_is_the_projects_and_its_placeholders_are_told() -> None:
    files = export_c(drawn(2), packages=("arduino", "platformio"))
    assert files["LICENSE"] == (ROOT / "LICENSE").read_text(encoding="utf-8")
    left = [place for place, text in files.items() if "example.org" in text]
    assert sorted(left) == ["README.md", "library.json", "library.properties"]
    assert all(f"`{place}`" in files["README.md"] for place in left if place != "README.md")


@pytest.mark.parametrize("limit", [None, 7.5])
def test_a_package_tells_a_limit_where_there_is_one(limit: float | None) -> None:
    files = export_c(coupling(1, wall=(0.0, 2e3), max_force_n=limit), packages=("arduino",))
    told = " ".join(files["README.md"].split())
    assert ("limited at 7.5 N, and" in told) == (limit is not None)
    assert ("has no limit: limit it yourself" in told) == (limit is None)
    assert ("the largest that is declared" in files["examples/wall/wall.ino"]) == (limit is not None)


CONSUMER = """
cmake_minimum_required(VERSION 3.15)
project(consumer LANGUAGES C CXX)
find_package(avc_coupling {version} REQUIRED)
add_executable(consumer main.cpp)
target_link_libraries(consumer PRIVATE avc_coupling::avc_coupling)
"""
MAIN = """
#include <avc_coupling.h>
#include <cstdio>
int main()
{
    avc_coupling_t coupling;
    avc_coupling_start(&coupling);
    for (int sample = 0; sample < 100; sample++) {
        const float position_m = 1e-5f * static_cast<float>(sample - 20);
        std::printf("%a\\n", static_cast<double>(avc_coupling_step(&coupling, position_m)));
    }
}
"""


def told(consumer: Path, made: Coupling) -> None:
    """Its forces are those of the coupling."""
    done = subprocess.run([consumer], capture_output=True, text=True, check=True)  # noqa: S603 - ours
    forces = [float.fromhex(line) for line in done.stdout.split()]
    positions = np.float32(1e-5) * np.arange(-20, 80, dtype=np.float32)
    assert forces == Exported(made).forces(positions).tolist()


@pytest.mark.thorough
def test_cmake_installs_what_another_project_finds() -> None:
    require("cmake", "g++")
    made = drawn(16)
    folder, prefix, consumer = written(made, "cmake"), scratch() / "prefix", scratch() / "consumer"
    consumer.mkdir()
    (consumer / "CMakeLists.txt").write_text(CONSUMER.format(version=avc_casadi.__version__), encoding="ascii")
    (consumer / "main.cpp").write_text(MAIN, encoding="ascii")
    flags = " ".join(WARNINGS)
    for source, options in (
        (folder, (f"-DCMAKE_INSTALL_PREFIX={prefix}", f"-DCMAKE_C_FLAGS={flags}")),
        (consumer, (f"-DCMAKE_PREFIX_PATH={prefix}", f"-DCMAKE_CXX_FLAGS={flags}")),
    ):
        build = str(source / "build")
        run("cmake", "-G", "Unix Makefiles", "-S", str(source), "-B", build, "-DCMAKE_BUILD_TYPE=Release", *options)
        run("cmake", "--build", build)
        if source == folder:
            run("cmake", "--install", build)
    told(consumer / "build" / "consumer", made)


# The commands of ESP-IDF and of Zephyr, as far as the packages use them.
STUBS = """
cmake_minimum_required(VERSION 3.15)
project(stub LANGUAGES C CXX)
set(MODULE {module})
if("{system}" STREQUAL "esp-idf")
  set(ESP_PLATFORM 1)
  function(idf_component_register)
    cmake_parse_arguments(own "" "" "SRCS;INCLUDE_DIRS" ${{ARGN}})
    add_library(of_system STATIC ${{own_SRCS}})
    target_include_directories(of_system PUBLIC ${{own_INCLUDE_DIRS}})
  endfunction()
  add_subdirectory(${{MODULE}} component)
else()
  add_library(of_system STATIC)
  function(zephyr_library)
  endfunction()
  function(zephyr_library_sources)
    foreach(source ${{ARGN}})
      target_sources(of_system PRIVATE ${{CMAKE_CURRENT_SOURCE_DIR}}/${{source}})
    endforeach()
  endfunction()
  function(zephyr_include_directories)
    foreach(folder ${{ARGN}})
      target_include_directories(of_system PUBLIC ${{CMAKE_CURRENT_SOURCE_DIR}}/${{folder}})
    endforeach()
  endfunction()
  add_subdirectory(${{MODULE}}/{cmake} module)
endif()
add_executable(consumer main.cpp)
target_link_libraries(consumer PRIVATE of_system)
"""


@pytest.mark.thorough
@pytest.mark.parametrize("system", ["esp-idf", "zephyr"])
def test_component_and_module_build_with_the_commands_of_their_systems(system: str) -> None:
    require("cmake", "g++")
    made = drawn(16)
    folder, stub = written(made, system), Path(tempfile.mkdtemp(dir=scratch()))
    if system == "zephyr":
        module = (folder / "zephyr" / "module.yml").read_text(encoding="ascii")
        (cmake,) = re.findall(r"^  cmake: (\w+)$", module, re.MULTILINE)
    else:
        cmake = ""
        assert f'version: "{avc_casadi.__version__}"' in (folder / "idf_component.yml").read_text(encoding="ascii")
    text = STUBS.format(module=folder, system=system, cmake=cmake)
    (stub / "CMakeLists.txt").write_text(text, encoding="ascii")
    (stub / "main.cpp").write_text(MAIN, encoding="ascii")
    run("cmake", "-G", "Unix Makefiles", "-S", str(stub), "-B", str(stub / "build"))
    run("cmake", "--build", str(stub / "build"))
    told(stub / "build" / "consumer", made)


CORE_FILES = (
    *("wiring.c", "wiring_digital.c", "wiring_analog.c", "WInterrupts.c", "hooks.c", "main.cpp", "Print.cpp"),
    *("HardwareSerial.cpp", "HardwareSerial0.cpp", "new.cpp", "abi.cpp"),
)
UNO = ("-mmcu=atmega328p", "-DF_CPU=16000000L", "-DARDUINO=10819", "-DARDUINO_AVR_UNO", "-DARDUINO_ARCH_AVR")
OWN = ("-Wall", "-Wextra", "-Werror")


def sketch(made: Coupling) -> Path:
    """Build the example for an Uno, as the Arduino IDE does: with its core, and Arduino.h before everything."""
    require("avr-gcc", "avr-g++", "simavr", str(CORE))
    folder = written(made, "arduino")
    places = (f"-I{CORE / 'arduino'}", f"-I{CORE.parent / 'variants' / 'standard'}", f"-I{folder / 'src'}")
    flags = (*UNO, "-Os", "-ffunction-sections", "-fdata-sections", *places)
    own = (folder / "src" / "avc_coupling.c", folder / "examples" / "wall" / "wall.ino")
    # In front of the wall, where every sample takes the whole law: at 0 since the start a depth may be a clipped one.
    text, count = own[1].read_text(encoding="ascii"), "static volatile long encoder_count"
    assert f"{count};" in text
    own[1].write_text(text.replace(f"{count};", f"{count} = -5;"), encoding="ascii")
    objects = []
    for source in (*(CORE / "arduino" / name for name in CORE_FILES), *own):
        c = source.suffix == ".c"
        language = ("-x", "c") if c else ("-std=gnu++11", "-fno-exceptions", "-fno-threadsafe-statics", "-x", "c++")
        before = ("-include", "Arduino.h") if source.suffix == ".ino" else ()
        objects.append(str(folder / f"{source.name}.o"))
        warnings = OWN if source in own else ("-w",)
        run("avr-gcc" if c else "avr-g++", *flags, *warnings, *before, *language, "-c", str(source), "-o", objects[-1])
    image = folder / "wall.elf"
    run("avr-gcc", *UNO, "-Os", "-Wl,--gc-sections", *objects, "-lm", "-o", str(image))
    return image


def first_words(image: Path) -> str:
    """Run the sketch until it has told its first line; the simulated board has no end of its own."""
    # Into a pipe it would keep its lines for itself.
    command = ["stdbuf", "-oL", "simavr", "-m", "atmega328p", "-f", "16000000", image]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as board:  # noqa: S603 - ours
        assert board.stdout is not None
        limit = threading.Timer(600, board.kill)
        limit.start()
        try:
            for line in board.stdout:
                if b"samples" in line or b"stopped" in line:
                    return re.sub("\x1b\\[[0-9;]*m", "", line.decode(errors="replace"))
        finally:
            limit.cancel()
            board.kill()
    return ""


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("runtime", "rows", "says"),
    [
        (Runtime(observer_mass_kg=0.25), 1, "missed samples of 1000: 0"),
        (Runtime("zero-crossing"), 40, "stopped: too slow for a sample of 1000 us"),
    ],
    ids=["observer", "table"],
)
def test_arduino_sketch_keeps_its_samples_or_switches_off(runtime: Runtime, rows: int, says: str) -> None:
    made = coupling(rows, largest=(300.0, 1e5, 50.0), runtime=runtime, encoder_resolution_m=2e-5, max_force_n=10.0)
    assert says in first_words(sketch(made))
