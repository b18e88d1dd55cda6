"""One table of all timings."""

from __future__ import annotations

from tests.benchmarks import models, timing


def main():
    chains = {"spherical joints": models.chain, "in a plane, revolute joints": models.planar_chain}
    for name, make in chains.items():
        print(f"Rigid chain, {name}, generalized-alpha, h = 1 ms, no output")
        print(f"{'bodies':>8} {'us/step':>10} {'us/body':>9} {'iterations':>11} {'factors':>8}")
        for n, count in ((1, 20000), (10, 5000), (100, 1000), (1000, 200)):
            seconds, iterations, factors = timing.per_step(*make(n), 1e-3, count)
            micro = 1e6 * seconds
            print(f"{n:8} {micro:10.2f} {micro / n:9.3f} {iterations:11.2f} {factors:8.2f}")
    print("\nSet-up of a rigid chain [s]: model, tables, first state, result file")
    print(f"{'joints':>12} {'bodies':>8} {'seconds':>9}  by stage")
    for joint, axis in (("spherical", None), ("revolute", "y")):
        for n in (1000, 10000):
            stages = timing.set_up(n, joint, axis=axis)
            parts = ", ".join(f"{stage} {seconds:.3f}" for stage, seconds in stages.items())
            print(f"{joint:>12} {n:8} {sum(stages.values()):9.3f}  {parts}")
    print("\nChain of 10 bars held by force elements, h = 1 ms, no output")
    print(f"{'element':>16} {'us/step':>10} {'iterations':>11} {'factors':>8}")
    for force in models.FORCES:
        seconds, iterations, factors = timing.per_step(*models.held_by(force), 1e-3, 2000)
        print(f"{force:>16} {1e6 * seconds:10.2f} {iterations:11.2f} {factors:8.2f}")
    print("\nSlider-crank with a flexible rod, h = 10 us, no output")
    print(f"{'modes':>8} {'us/step':>10} {'iterations':>21} {'factors':>8}")
    for modes in (14, 20, 94):
        model, compiled, m = models.slider_crank(modes)
        seconds, iterations, factors = timing.per_step(model, compiled, 1e-5, 4000)
        print(f"{m:8} {1e6 * seconds:10.2f} {iterations:21.2f} {factors:8.2f}")
    print("\nError control against as many fixed steps")
    print(f"{'scene':>16} {'accuracy':>9} {'steps':>8} {'rejected':>9} {'ratio':>6}  iterations")
    for name, (model, compiled) in {
        "chain of 10": models.chain(10),
        "chain of 100": models.chain(100),
        "slider-crank": models.slider_crank(20)[:2],
    }.items():
        for accuracy in (1e-4, 1e-6):
            ratio, steps, rejected, found = timing.control_overhead(model, compiled, accuracy)
            both = f"{found[0]:.2f} {found[1]:.2f}"
            print(f"{name:>16} {accuracy:9.0e} {steps:8} {rejected:9} {ratio:6.2f}  {both}")
    print(f"\nimport flexmb: {timing.import_time():.2f} s")
    fresh, warm = timing.whole_runs()
    print("\nSlider-crank case from mesh to picture [s]      fresh cache       again")
    for name in fresh:
        print(f"{name:40} {fresh[name]:18.2f} {warm.get(name, 0.0):11.2f}")


if __name__ == "__main__":
    main()
