"""What instructions a CUDA kernel is made of: its cubin, through `cuobjdump -sass`."""

import re
import shutil
import subprocess
from collections import Counter
from importlib.util import find_spec
from pathlib import Path

import warp as wp

# by opcode, the first that fits; what fits none counts as integers and logic
KINDS = {
    "tensor": r"[HIQBD]G?MMA",
    "matrix moves": r"LDSM|STSM|MOVM",
    "shared": r"LDS|STS|ATOMS|SHFL",
    "global": r"LDG|STG|LD|ST|RED|REDG|ATOM|ATOMG|LDGSTS",
    "local": r"LDL|STL",
    "convert": r"[FI]2[FI]P?|FRND",
    "float": r"[FHD](ADD|MUL|FMA|MNMX|SETP?|SEL|SET|CHK|SWZADD)2?3?|MUFU",
    "move": r"U?MOV|IMAD\.MOV|U?P2R|U?R2P|R2UR|S2U?R|CS2R|U?LDCU?",
    "control": r"BRA|BRX|EXIT|RET|CALL|BSSY|BSYNC|BREAK|BMOV|WARPSYNC|BAR|VOTEU?|MATCH|DEPBAR|LDGDEPBAR|MEMBAR|"
    "ENDCOLLECTIVE|CCTL|NANOSLEEP|YIELD|WARPGROUP|FENCE",
}
REST = "integer"
INSTRUCTION = re.compile(r"^\s*/\*[0-9a-f]{4,}\*/\s+(?:@!?U?P\w+\s+)?([A-Z][A-Z0-9]*(?:\.MOV)?)", re.MULTILINE)


def find_tool(name: str) -> str | None:
    """A program of the CUDA toolkit: on PATH, in /usr/local/cuda*, or the one that Triton's wheel carries."""
    places = [str(path) for path in Path("/usr/local").glob(f"cuda*/bin/{name}")]
    triton = find_spec("triton")
    for folder in triton.submodule_search_locations if triton else ():
        places.append(str(Path(folder) / "backends/nvidia/bin" / name))
    return shutil.which(name) or next((place for place in places if Path(place).exists()), None)


def kind_of(opcode: str) -> str:
    return next((kind for kind, pattern in KINDS.items() if re.fullmatch(pattern, opcode)), REST)


def mix_of(text: str) -> dict[str, int]:
    """Instructions of each kind in a listing by `cuobjdump -sass`; without the NOPs that pad it."""
    opcodes = [opcode for opcode in INSTRUCTION.findall(text) if opcode != "NOP"]
    counts = Counter(map(kind_of, opcodes))
    return {kind: counts[kind] for kind in (*KINDS, REST)}


def mix(tool: str, command: wp.Launch) -> dict[str, int]:
    """Of a recorded launch, whose cubin lies in Warp's cache."""
    name = command.kernel.module.get_module_identifier(block_dim=command.block_dim)
    cubins = sorted((Path(wp.config.kernel_cache_dir) / name).glob("*.cubin"))
    if not cubins:
        raise RuntimeError(f"no cubin in {wp.config.kernel_cache_dir}/{name}")
    return mix_of(subprocess.run([tool, "-sass", str(cubins[-1])], capture_output=True, text=True, check=True).stdout)
