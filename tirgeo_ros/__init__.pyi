# Types of the public interface; __init__.py imports each name when it is first used.

from tirgeo_ros.core.camera.camera_model import Camera as Camera
from tirgeo_ros.core.frames.tangent_plane import TangentPlane as TangentPlane
from tirgeo_ros.core.ground.dem import Terrain as Terrain
from tirgeo_ros.core.ground.ground_point import Ellipse as Ellipse
from tirgeo_ros.core.ground.ground_point import Located as Located
from tirgeo_ros.core.ground.ground_point import Refusal as Refusal
from tirgeo_ros.core.types.errors import TirgeoError as TirgeoError
from tirgeo_ros.core.types.poses import CameraPose as CameraPose
from tirgeo_ros.io.elevation.elevation_model import load_terrain as load_terrain
from tirgeo_ros.io.pictures.camera_file import load_camera as load_camera
from tirgeo_ros.io.surveys.survey import Observation as Observation
from tirgeo_ros.io.surveys.survey import SurveyPoint as SurveyPoint
from tirgeo_ros.io.surveys.survey import load_observations as load_observations
from tirgeo_ros.io.surveys.survey import load_survey as load_survey
from tirgeo_ros.library.bags import Picture as Picture
from tirgeo_ros.library.bags import read_bag as read_bag
from tirgeo_ros.library.bags import read_camera as read_camera
from tirgeo_ros.library.bags import read_pictures as read_pictures
from tirgeo_ros.library.bags import write_bag as write_bag
from tirgeo_ros.library.filtered_flight import FilteredFlight as FilteredFlight
from tirgeo_ros.library.filtering import filter_flight as filter_flight
from tirgeo_ros.library.parameters import load_config as load_config
from tirgeo_ros.library.picture_pose import PicturePose as PicturePose
from tirgeo_ros.library.projecting import Projected as Projected
from tirgeo_ros.library.projecting import locate as locate
from tirgeo_ros.library.projecting import project as project
from tirgeo_ros.library.projecting import save_located as save_located
from tirgeo_ros.tools.replay.node_configs import NodeConfigs as NodeConfigs
from tirgeo_ros.tools.replay.process import process as process

__all__: list[str]
__version__: str
