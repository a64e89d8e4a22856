"""`perf.profile`: what it reads of programs and counters, and that it says what is missing. Its figures need CUDA."""

import pytest
import warp as wp

from perf import counters, networks, pictures, profile, report, sass, training
from perf.goals import GOALS
from perf.results import Figure, Result
from warp_neural.cli import run
from warp_neural.imaging.image import load_image
from warp_neural.io.files import atomic_path

SASS = """
	code for sm_90
		Function : shade_kernel_af614cba_cuda_kernel_forward
        /*0000*/                   LDC R1, c[0x0][0x28] ;                          /* 0x00000a00ff017b82 */
                                                                                   /* 0x000e220000000800 */
        /*0030*/                   IMAD.MOV.U32 R3, RZ, RZ, RZ ;                   /* 0x000000ffff037224 */
        /*0080*/                   IADD3 R1, R1, -0x1c0, RZ ;                      /* 0xfffffe4001017810 */
        /*00b0*/               @P0 EXIT ;                                          /* 0x000000000000094d */
        /*0120*/                   LDG.E.128.CONSTANT R4, desc[UR8][R4.64] ;       /* 0x0000000804047981 */
        /*0150*/              @!P1 STS.128 [R0+UR4], R8 ;                          /* 0x0000000800007988 */
        /*0180*/                   LDSM.16.M88.4 R12, [R2] ;                       /* 0x000000000c02783b */
        /*01a0*/                   HMMA.16816.F16 R8, R8, R12, RZ ;                /* 0x0000000c0808723c */
        /*01b0*/                   HMMA.16816.F16 R10, R8, R14, R10 ;              /* 0x0000000e0808723c */
        /*01c0*/              @UP0 UMOV UR4, 0x400 ;                               /* 0x0000040000047882 */
        /*01d0*/                   HFMA2.MMA R3, -RZ, RZ, 1.875, 0 ;               /* 0x3f800000ff037435 */
        /*01e0*/                   F2FP.F16.F32.PACK_AB R6, R7, R6 ;               /* 0x000000060706723e */
        /*01f0*/                   STL.64 [R1+0x40], R6 ;                          /* 0x0000400601007387 */
        /*0200*/                   REDG.E.ADD.F32.FTZ.RN.STRONG.GPU desc[UR4][R2.64], R5 ;  /* 0x000000050200798e */
        /*0220*/                   BRA 0x220;                                      /* 0xfffffffc00fc7947 */
        /*0230*/                   NOP;                                            /* 0x0000000000007918 */
"""
EXPECTED = {"tensor": 2, "matrix moves": 1, "shared": 1, "global": 2, "local": 1, "convert": 1, "float": 1, "move": 3}

NCU = """==PROF== Connected to process 12
==PROF== Profiling "shade_kernel" - 0: 0%....100% - 3 passes
"ID","Process ID","Kernel Name","dram__bytes.sum.per_second","gpu__time_duration.sum","sm__inst_issued.avg.pct_of_peak_sustained_active","lts__t_sectors.avg.pct_of_peak_sustained_elapsed"
"","","","byte/second","ns","%","%"
"0","12","shade_kernel","1,234,000,000.5","63,488","47.25","n/a"
"1","12","update_kernel","0","4,100","1","2.5"
"""  # noqa: E501


def test_instructions_by_kind():
    found = sass.mix_of(SASS)
    assert found == dict.fromkeys((*sass.KINDS, sass.REST), 0) | EXPECTED | {"control": 2, "integer": 1}


def test_counters():
    first, second = counters.parse(NCU)
    assert first == {"time": pytest.approx(63.488), "issue slots": 47.25, "DRAM rate": pytest.approx(1.2340000005)}
    assert second["L2"] == 2.5 and second["time"] == pytest.approx(4.1)
    assert counters.parse("==ERROR== ERR_NVGPUCTRPERM\n") == []


@pytest.mark.parametrize(
    "output, message",
    [
        ("==ERROR== ERR_NVGPUCTRPERM - not allowed\n", "no counters: ncu says: ERR_NVGPUCTRPERM - not allowed"),
        (NCU, "no counters: ncu says: 2 kernels of 3"),
    ],
)
def test_ncu_that_cannot_count(monkeypatch, output, message):
    class Done:
        stdout, stderr = output, ""

    monkeypatch.setattr(counters, "find_tool", lambda name: name)
    monkeypatch.setattr(counters.subprocess, "run", lambda *args, **options: Done)
    with pytest.raises(RuntimeError, match=message):
        counters.count(["-m", "perf.profile"], 3)


def test_without_tools(monkeypatch):
    monkeypatch.setattr(counters, "find_tool", lambda name: None)
    with pytest.raises(RuntimeError, match="ncu is neither on PATH nor in /usr/local/cuda"):
        counters.count([], 1)
    assert sass.find_tool("no-such-tool") is None


def test_profile_needs_cuda(capsys):
    with pytest.raises(SystemExit) as stopped:
        run(profile.main, profile.ProfileConfig, ["--device", "cpu"])
    assert stopped.value.code == 2 and "perf.profile looks at CUDA kernels" in capsys.readouterr().err


def test_recorded_launches_run_again(device):
    y = wp.zeros(64, dtype=float, device=device)
    net = networks.make_net(2, 32, seed=0, precision="float32", device=device)
    kernel = networks.make_shade_kernel(net)
    (command,) = profile.recorded(lambda: wp.launch(kernel, 64, [net.params, 30, 0, y], device=device, block_dim=64))
    first = y.numpy().copy()
    y.zero_()
    command.launch()
    assert first.any() and (y.numpy() == first).all() and command.block_dim == (64 if device.is_cuda else 1)


@pytest.mark.cuda
def test_resources(device):
    if device.is_cpu:
        pytest.skip("needs CUDA")
    y = wp.zeros(64, dtype=float, device=device)
    net = networks.make_net(2, 32, seed=0, device=device)
    kernel = networks.make_shade_kernel(net)
    (command,) = profile.recorded(lambda: wp.launch(kernel, 64, [net.params, 30, 0, y], device=device, block_dim=64))
    found = counters.resources(command)
    assert 16 <= found["registers"] <= 255 and found["warps"] % 2 == 0 and 0 < found["warps"] <= 64
    tool = sass.find_tool("cuobjdump")
    assert tool is None or sass.mix(tool, command)["tensor"] > 0


def small_profile() -> Result:
    result = Result("profile", {"device": "Some GPU"}, {})
    for row in ("network 2x32, float16, float16 sums", "memory 3x16", "train a, 1: x", "train a, 2: y"):
        values = {"registers": (96, ""), "tensor instructions": (64, ""), "move instructions": (9, "")}
        for column, (value, unit) in (values | {"tensor pipe": (45.0, "%"), "DRAM rate": (1200.0, "GB/s")}).items():
            result.figures.append(Figure(row, column, value, value, value, unit))
    return result


def test_picture_and_words(tmp_path):
    result = small_profile()
    with atomic_path(tmp_path / "profile.png") as path:
        pictures.shares(result).savefig(path)
    assert load_image(tmp_path / "profile.png").std() > 0.01
    goal = next(goal for goal in GOALS if goal.kernel == result.figures[0].row)
    text = report.reason(goal, {"profile": result})
    assert text.startswith(goal.why)
    assert text.endswith(f"*{goal.kernel}*: registers 96, tensor pipe 45 %, DRAM rate 1,200 GB/s.")
    assert report.reason(goal, {}) == goal.why
    one = "registers 96, tensor pipe 45 %, DRAM rate 1,200 GB/s."
    assert profile.spoken(result, "train a") == f"*train a, 1: x*: {one} *train a, 2: y*: {one}"


def test_goals_name_rows_of_the_profile():
    shapes = [networks.shape_name(*shape) for shape in networks.SHAPES]
    kinds = [f"{precision}, {sums} sums" for precision, sums in profile.KINDS]
    rows = {f"network {shape}, {kind}" for shape in shapes for kind in kinds}
    rows |= {f"memory {name}" for name in (*shapes, "3x16", "3x128")}
    rows |= {f"train {networks.shape_name(*shape)}, gradient" for shape in training.SHAPES}
    assert {goal.kernel for goal in GOALS if goal.kernel} <= rows | {
        f"train {name}, gradient" for name in ("frequency", "hash grid")
    }
