"""What a UAV senses: gas (hits or concentration), the wind, distances; and how gas sensors fail."""

from osl_env.sensors.anemometer import Anemometer, measure_wind
from osl_env.sensors.base import RESPONSE, GasSensor
from osl_env.sensors.concentration import ConcentrationSensor, IdealSensor, MoxSensor, PidSensor
from osl_env.sensors.counter import PoissonCounter, count_with_dead_time, sample
from osl_env.sensors.faults import FAULTS, SensorFault, fault_table
from osl_env.sensors.ranges import RangeSensors, add_range_noise, begin_range_streams
from osl_env.sensors.sniffing import SNIFFER, begin_sniffers, sample_concentration, sniff

__all__ = [
    "FAULTS",
    "RESPONSE",
    "SNIFFER",
    "Anemometer",
    "ConcentrationSensor",
    "GasSensor",
    "IdealSensor",
    "MoxSensor",
    "PidSensor",
    "PoissonCounter",
    "RangeSensors",
    "SensorFault",
    "add_range_noise",
    "begin_range_streams",
    "begin_sniffers",
    "count_with_dead_time",
    "fault_table",
    "measure_wind",
    "sample",
    "sample_concentration",
    "sniff",
]
