"""Choose the Mitsuba variant (CPU or GPU) of a process, and the LLVM library that the CPU variant needs.

Dr.Jit, the compiler inside Mitsuba, compiles CPU kernels with the LLVM library of the system. Dr.Jit refuses LLVM 14. LLVM 15 and 16 abort
the whole process, because they cannot compile the operation fmaximum. This module therefore selects a newer LLVM library before Dr.Jit
loads one.
"""

import argparse
import ctypes
import functools
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from radartwin.compiled import cores
from radartwin.errors import BackendError
from radartwin.io import memory

LLVM_MINIMUM = 17
_FOLDERS = (
    "/usr/lib/x86_64-linux-gnu",
    "/usr/lib/aarch64-linux-gnu",
    "/usr/lib64",
    "/usr/lib",
    "/usr/local/lib",
    "/opt/homebrew/opt/llvm/lib",
)
REMEDY = "install LLVM 17 or newer (Debian/Ubuntu: apt-get install libllvm19) or set DRJIT_LIBLLVM_PATH to its library"


def llvm_version(library: Path) -> int | None:
    """Return the major version of an LLVM library, or None if the version cannot be read.

    The function reads the version from the file name (for example libLLVM-19.so), or else from the library itself.
    """
    match = re.search(r"libLLVM(?:-|\.so\.)(\d+)", library.resolve().name) or re.search(r"libLLVM(?:-|\.so\.)(\d+)", library.name)
    if match:
        return int(match.group(1))
    try:
        handle = ctypes.CDLL(str(library))
        major = ctypes.c_uint()
        handle.LLVMGetVersion(ctypes.byref(major), None, None)
    except (OSError, AttributeError):
        return None
    return int(major.value)


def find_llvm() -> Path | None:
    """Return the path of the newest LLVM library of version LLVM_MINIMUM or newer, or None if the system has no such library.

    If the environment variable DRJIT_LIBLLVM_PATH is set, the function considers only the library at this path.
    """
    explicit = os.environ.get("DRJIT_LIBLLVM_PATH")
    if explicit:
        candidates = [Path(explicit)]
    else:
        folders = [Path(f) for f in _FOLDERS] + sorted(Path("/usr/lib").glob("llvm-*/lib"))
        candidates = [p for folder in folders for p in folder.glob("libLLVM*") if re.search(r"\.so(\.|$)|\.dylib$", p.name)]
    usable = [(version, path) for path in candidates if path.exists() and (version := llvm_version(path)) and version >= LLVM_MINIMUM]
    return max(usable)[1] if usable else None


def has_cuda() -> bool:
    """Return whether nvidia-smi lists a GPU, and the environment variable CUDA_VISIBLE_DEVICES does not hide all GPUs."""
    if shutil.which("nvidia-smi") is None or os.environ.get("CUDA_VISIBLE_DEVICES") in ("", "-1"):
        return False
    answer = subprocess.run(["nvidia-smi", "-L"], capture_output=True, text=True, check=False)
    return answer.returncode == 0 and "GPU" in answer.stdout


@functools.cache
def activate(preference: str = "auto", color: str = "rgb") -> str:
    """Set the Mitsuba variant of this process and return its name.

    After the call, the process keeps freed memory for its own use instead of returning it to the operating system.

    Args:
        preference: "llvm" for the CPU, "cuda" for the GPU, or "auto" for the GPU if nvidia-smi finds a GPU and otherwise the CPU.
        color: colour mode of the Mitsuba variant, for example "rgb".
    Raises:
        BackendError: "cuda" is requested and there is no GPU, the CPU variant finds no LLVM 17 or newer, or another variant is active.
    """
    if preference not in ("auto", "llvm", "cuda"):
        raise BackendError(f"simulator variant {preference!r} is not one of auto, llvm, cuda")
    cuda = preference == "cuda" or (preference == "auto" and has_cuda())
    if preference == "cuda" and not has_cuda():
        raise BackendError("simulator variant 'cuda': nvidia-smi lists no GPU; use variant llvm or auto")
    if not cuda:
        library = find_llvm()
        if library is None:
            explicit = os.environ.get("DRJIT_LIBLLVM_PATH")
            cause = f"DRJIT_LIBLLVM_PATH={explicit} is too old or unreadable" if explicit else "no LLVM >= 17 found"
            raise BackendError(f"CPU tracing: {cause}; {REMEDY}")
        os.environ["DRJIT_LIBLLVM_PATH"] = str(library)
    import mitsuba as mi

    name = f"{'cuda' if cuda else 'llvm'}_ad_{color}"
    if mi.variant() is not None and mi.variant() != name:
        raise BackendError(f"Mitsuba variant {mi.variant()!r} is active in this process; use a new process for {name!r}")
    mi.set_variant(name)
    memory.keep_freed()
    return name


def share_threads() -> None:
    """Give Dr.Jit as many processor threads as this process should use now (`compiled.cores`).

    On two cores, two workers that simulated randomly drawn targets took 15 % less processor time with one thread per worker than with two.
    """
    import drjit

    if drjit.thread_count() != cores():
        drjit.set_thread_count(cores())


def on_gpu() -> bool:
    """Return whether Mitsuba's GPU variant is active in this process, so that Dr.Jit computes on the GPU."""
    mitsuba = sys.modules.get("mitsuba")
    return mitsuba is not None and str(mitsuba.variant()).startswith("cuda")


def ensure_llvm() -> int:
    """Install LLVM if the computer has neither a GPU nor a usable LLVM library. If the installation fails, print the command to type.

    Returns:
        Exit status: 0 if a GPU or a usable LLVM library exists, 2 otherwise.
    """
    if has_cuda() or find_llvm() is not None:
        return 0
    prefix = [] if os.geteuid() == 0 else ["sudo", "-n"]
    if shutil.which("apt-get") and (not prefix or shutil.which("sudo")):
        print("installing libllvm19 for CPU tracing")
        for command in (["apt-get", "update", "-qq"], ["apt-get", "install", "-y", "-qq", "libllvm19"]):
            if subprocess.run([*prefix, *command], stdout=subprocess.DEVNULL, stdin=subprocess.DEVNULL, check=False).returncode:
                break
        if find_llvm() is not None:
            return 0
    print(f"CPU tracing needs LLVM: {REMEDY}", file=sys.stderr)
    return 2


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Find, or with --ensure install, the LLVM library for CPU tracing.")
    parser.add_argument("--ensure", action="store_true", help="install LLVM if it is missing")
    if parser.parse_args().ensure:
        sys.exit(ensure_llvm())
    print(find_llvm() or "no LLVM >= 17")
