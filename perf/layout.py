"""Speed by the layout of the weights: `python -m perf.layout`; one network of single operations, float16."""

from perf import fusion
from perf.measure import Bench, Config
from perf.pictures import bars
from warp_neural.cli import progress, run

LAYOUTS = ("inferencing_optimal", "row_major", "column_major")


def main(config: Config) -> dict:
    bench = Bench("layout", config, precision="float16, float16 sums", block=fusion.BLOCK)
    net, n = fusion.chain_network(config, bench.device)
    bench.result.settings |= {"network": "single operations", "threads": f"{n:,}"}
    for layout in progress(LAYOUTS, config):
        stored, layers = fusion.store(net, layout)
        fusion.measure(bench, layout.replace("_", " "), fusion.make_chain_kernel(net, layers), [stored], net, n)
    return bench.finish(lambda result: bars(result, "Layout of the weights", bench.speed_unit))


if __name__ == "__main__":
    run(main, Config)
